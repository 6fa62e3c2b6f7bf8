"""The decoder as a host runs it, with its gates, on frames that no Nano would send.

``test_decoder.py`` damages streams of a sane car; here the values are any that
pass the CRC, in any order, with damage and noise between them.
"""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import MAX_BLOCK
from dart_hal.wire.plausible import Gates
from tests.wire import wire_samples as samples

MOST = 255 + 1
"""Numbers that one frame can add to the count of lost ones."""


def hostile(rng, frames):
    """Any values, any numbers, any order; a third is hurt, and noise lies between."""
    for _ in range(frames):
        message = rng.choice(UP)
        frame = encode(message, rng.randrange(256), samples.random_values(message, rng))
        kind = rng.randrange(6)
        if kind == 0:
            frame = rng.choice(list(samples.SMALL_FAULTS.values()))(frame, rng)
        elif kind == 1:
            frame += rng.randbytes(rng.randrange(2 * MAX_BLOCK))
        yield frame


def feed_stream(stream, cut=None):
    """Frames and counters, in reads of ``cut()`` bytes; the memory is looked at after each."""
    decoder = FrameDecoder(UP, Gates())
    frames = []
    at = 0
    while at < len(stream):
        size = cut() if cut else len(stream)
        frames += decoder.feed(stream[at:at + size])
        assert len(decoder._tail) <= MAX_BLOCK + 1
        at += size
    return frames, decoder.counters


def laws(seed, frames):
    rng = Random(seed)
    stream = b"".join(hostile(rng, frames))
    got, counters = feed_stream(stream)
    assert (got, counters) == feed_stream(stream, lambda: rng.randrange(1, 90))
    assert counters.ok == len(got)
    assert [f.end for f in got] == sorted(f.end for f in got)
    assert 0 <= counters.gaps <= MOST * len(got)
    for frame in got:
        frame.record(), frame.as_si()
    return counters


@given(st.integers(0, 2**64))
def test_any_frames_in_any_reads(seed):
    laws(seed, 60)


def test_the_streams_reach_every_counter():
    """The control: what is fed is neither all good nor all noise."""
    counters = laws(1, 2000)
    assert 600 < counters.ok < 1900
    assert min(counters.implausible, counters.gaps, counters.cobs, counters.crc, counters.length,
               counters.unknown, counters.oversize) > 0


@pytest.mark.long
def test_a_million_frames_in_any_reads():
    for seed in range(1000):
        laws(seed, 1000)
