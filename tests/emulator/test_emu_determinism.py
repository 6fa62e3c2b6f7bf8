"""The same scenario gives the same bytes and stamps, however its run is sliced."""

from __future__ import annotations

import hashlib
import math

import pytest

from dart_hal.devices.links.emulator import EmulatedNano

pytestmark = pytest.mark.emulator
EVEN_MARKS = [i / 20 for i in range(20)]
WORLD_TICK = 0.01


def scenario(image, slice_s, seconds=1.0, rate=30.0, **options):
    """The world advances every 10 ms, the host reads every 30 ms, runs cut each ``slice_s``."""
    with EmulatedNano(image, **options) as nano:
        nano.set_ring(0, EVEN_MARKS)
        nano.set_ring(1, EVEN_MARKS[::2])
        data = bytearray()
        stamps = []
        per_tick = round(WORLD_TICK / slice_s)
        for k in range(round(seconds / WORLD_TICK)):
            nano.set_wheel(rate * math.sin(0.05 * k))
            nano.set_imu((0.1, math.sin(0.1 * k), -2.0), (1.0, 0.0, math.cos(0.07 * k)))
            if k % 3 == 2:
                nano.write(b"c" if k % 2 else b"t\x08\x12")
            for i in range(1, per_tick + 1):
                until = k * WORLD_TICK + i * slice_s if i < per_tick else (k + 1) * WORLD_TICK
                more = True
                while more:
                    more = nano.run(until)
                    for chunk, t in nano.read():
                        data += chunk
                        stamps.append((len(data), t))
        return bytes(data), dict(stamps), nano.cycle


def digest(data):
    return hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize("slice_s", [0.0001, 0.001, 0.0007142857])
def test_slices_leave_no_trace(probe, slice_s):
    whole, whole_stamps, cycle = scenario(probe, WORLD_TICK)
    cut, cut_stamps, cut_cycle = scenario(probe, slice_s)
    assert len(whole) > 300
    assert digest(cut) == digest(whole)
    assert cut_cycle == cycle
    common = whole_stamps.keys() & cut_stamps.keys()
    assert len(common) > 50
    assert all(cut_stamps[k] == whole_stamps[k] for k in common)  # to the cycle


@pytest.mark.slow
@pytest.mark.parametrize("slice_s", [0.0001, 0.001])
def test_slices_of_the_firmware_leave_no_trace(firmware, slice_s):
    whole, whole_stamps, _ = scenario(firmware, WORLD_TICK, seconds=1.5)
    cut, cut_stamps, _ = scenario(firmware, slice_s, seconds=1.5)
    assert digest(cut) == digest(whole)
    common = whole_stamps.keys() & cut_stamps.keys()
    assert len(common) > 50
    assert all(cut_stamps[k] == whole_stamps[k] for k in common)


def test_two_runs_are_identical_and_two_worlds_are_not(probe):
    assert scenario(probe, 0.001) == scenario(probe, 0.001)
    assert digest(scenario(probe, 0.001)[0]) != digest(scenario(probe, 0.001, rate=31.0)[0])
    assert scenario(probe, 0.001)[1] != scenario(probe, 0.001, clock_error=1e-3)[1]


def test_emulators_do_not_disturb_each_other(probe):
    alone = scenario(probe, 0.001)
    with EmulatedNano(probe, clock_error=0.003) as other:
        other.run(0.5)
        assert scenario(probe, 0.001) == alone
        other.run(1.0)
