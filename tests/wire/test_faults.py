"""What damage costs: wrong frames, lost frames, delayed frames."""

from math import comb
from random import Random

import pytest

from dart_hal.wire import blocks
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE
from dart_hal.wire.plausible import Gates
from tests.wire import wire_samples as samples

DRIVE_FRAMES = samples.drive(2.0, seed=3)
STATE_FRAMES = [f for f in DRIVE_FRAMES if len(f) == STATE.wire_size]
SENT = {(f.seq, f.payload) for f in FrameDecoder(UP).feed(b"".join(DRIVE_FRAMES))}


class AnyCrc:
    def __eq__(self, other):
        return True

    __hash__ = None


def wrong(fault, trials, seed, gates=None):
    """Accepted frames that were never sent, in so many damaged STATE frames.

    Each one is between two undamaged neighbours, so that a fault in the
    delimiter and its repair take part.
    """
    rng = Random(seed)
    count = 0
    for _ in range(trials):
        at = rng.randrange(1, len(STATE_FRAMES) - 1)
        before, frame, after = STATE_FRAMES[at - 1:at + 2]
        decoder = FrameDecoder(UP, gates() if gates else None)
        got = decoder.feed(before + fault(frame, rng) + after)
        count += sum((f.seq, f.payload) not in SENT for f in got)
    return count


def test_every_single_bit():
    frame = STATE_FRAMES[7]
    original = FrameDecoder(UP).feed(frame)[0]
    for at in range(8 * (len(frame) - 1)):
        value = int.from_bytes(frame, "little") ^ 1 << at
        for got in FrameDecoder(UP).feed(value.to_bytes(len(frame), "little")):
            assert (got.seq, got.payload) == (original.seq, original.payload)


def test_every_pair_of_bits():
    frame = STATE_FRAMES[11]
    bits = 8 * (len(frame) - 1)
    value = int.from_bytes(frame, "little")
    stream = b"\0".join((value ^ 1 << i ^ 1 << j).to_bytes(len(frame), "little")
                        for i in range(bits) for j in range(i))
    decoder = FrameDecoder(UP)
    assert decoder.feed(stream) == []
    assert decoder.counters.damaged >= comb(bits, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", samples.SMALL_FAULTS)
def test_no_small_fault_passes(name):
    assert wrong(samples.SMALL_FAULTS[name], 6000, seed=1) == 0


def test_without_the_crc_they_would_pass(monkeypatch):
    """Negative control: the same test sees a decoder that does not check."""
    monkeypatch.setattr(blocks, "crc_hqx", lambda data, seed: AnyCrc())
    assert wrong(samples.SMALL_FAULTS["2 bits"], 500, seed=1) > 100


@pytest.mark.long
@pytest.mark.parametrize("name", samples.SMALL_FAULTS)
def test_no_small_fault_passes_in_a_million(name):
    assert wrong(samples.SMALL_FAULTS[name], 1_000_000 // len(samples.SMALL_FAULTS) + 1, 2) == 0


@pytest.mark.long
@pytest.mark.parametrize(("fault", "gates", "bound"), [
    (samples.flip_bits(4), None, 1.5e-5), (samples.burst(8), None, 1.5e-5),
    (samples.flip_bits(6), Gates, 5e-6)])
def test_heavy_damage_stays_below_the_published_bound(fault, gates, bound):
    """Below the bound at five sigma of a Poisson count."""
    trials = 400_000
    expected = bound * trials
    assert wrong(fault, trials, 4, gates) <= expected + 5 * expected ** 0.5


@pytest.mark.parametrize("name", [*samples.SMALL_FAULTS, "burst"])
@pytest.mark.slow_except("burst")
def test_frames_lost_per_fault(name):
    """At most one; two when a delimiter is gone; none when it was only changed."""
    fault = samples.burst(8) if name == "burst" else samples.SMALL_FAULTS[name]
    rng = Random(8)
    for _ in range(1500):
        at = rng.randrange(1, len(DRIVE_FRAMES) - 3)
        hurt = fault(DRIVE_FRAMES[at], rng)
        decoder = FrameDecoder(UP)
        decoder.feed(DRIVE_FRAMES[at - 1] + hurt + DRIVE_FRAMES[at + 1] + DRIVE_FRAMES[at + 2])
        lost = 4 - decoder.counters.ok
        assert lost <= (1 if hurt.endswith(b"\0") else 2)


def test_delimiter_changed_costs_none_and_deleted_costs_two():
    rng = Random(9)
    for at in range(1, len(DRIVE_FRAMES) - 1):
        if len(DRIVE_FRAMES[at]) not in {m.wire_size for m in UP} or DRIVE_FRAMES[at][1] == 0x15:
            continue
        changed = DRIVE_FRAMES[at][:-1] + bytes([rng.randrange(1, 256)])
        before, after = DRIVE_FRAMES[at - 1], DRIVE_FRAMES[at + 1]
        assert len(FrameDecoder(UP).feed(before + changed + after)) == 3
        deleted = DRIVE_FRAMES[at][:-1]
        assert len(FrameDecoder(UP).feed(before + deleted + after)) == 1


@pytest.mark.parametrize("name", [*samples.SMALL_FAULTS, "burst"])
def test_good_frames_are_not_delayed(name):
    """After the next delimiter each frame is there with its own last byte."""
    fault = samples.burst(8) if name == "burst" else samples.SMALL_FAULTS[name]
    rng = Random(10)
    for _ in range(60):
        at = rng.randrange(2, len(DRIVE_FRAMES) - 5)
        decoder = FrameDecoder(UP)
        decoder.feed(DRIVE_FRAMES[at - 1])
        decoder.feed(fault(DRIVE_FRAMES[at], rng))
        decoder.feed(DRIVE_FRAMES[at + 1])
        for frame in DRIVE_FRAMES[at + 2:at + 5]:
            assert decoder.feed(frame[:-1]) == []
            assert len(decoder.feed(frame[-1:])) == 1
