"""Long runs: hours of driving, millions of blocks."""

from random import Random

import numpy as np
import pytest

from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import STATE
from tests.wire import wire_samples as samples

FAULTS = [*samples.SMALL_FAULTS.values(), samples.burst(8)]


@pytest.mark.long
def test_a_long_damaged_recording():
    """Some 300 000 frames, a third of them hurt: past the wrap of device time."""
    rng = Random(12)
    frames = samples.drive(2800.0, seed=7)
    stream = b"".join(rng.choice(FAULTS)(f, rng) if rng.random() < 0.3 and len(f) > 8 else f
                   for f in frames)
    decoder = FrameDecoder(UP)
    decoder.feed(stream)
    # A fault in the delimiter may cost two or none.
    assert decoder.counters.ok + decoder.counters.gaps == pytest.approx(len(frames), abs=3)


@pytest.mark.long
def test_ten_million_blocks_of_noise():
    """Random bytes, many of the length of a STATE, none of them sent by anybody."""
    rng = np.random.default_rng(13)
    accepted = 0
    for _ in range(50):
        noise = rng.integers(1, 256, (200_000, 44), np.uint8)
        noise[:, 0], noise[:, 1], noise[:, -1] = 2 + noise[:, 0] % 42, STATE.id, 0
        accepted += len(FrameDecoder(UP).feed(noise.tobytes()))
    # Few chains of codes end in the right place, and 2^-16 of those pass the CRC.
    assert accepted <= 10_000_000 / 2**16
