"""The BNO055 model over the bus: boot, modes, units, offsets, filters, faults."""

from __future__ import annotations

import math
import struct

import pytest

pytestmark = pytest.mark.emulator

CONFIG = 0x00
IMUPLUS = 0x08
GYRO = 0x14
LINEAR = 0x28


@pytest.fixture
def part(nano):
    """A Nano whose BNO055 has booted and is in CONFIG; no stretching."""
    nano.drain(0.5)
    nano.set_i2c("ok", stretch_us=0)
    return nano


def read(nano, register, n):
    """Registers as the program reads them, without the status codes between."""
    answer = nano.ask(bytes([ord("t"), register, n]), 0.02)
    return answer[6::2]


def write(nano, register, *values):
    for i, value in enumerate(values):
        assert nano.ask(bytes([ord("W"), register + i, value]), 0.005) == b"\x08\x18\x28\x28"


def run_mode(nano, mode=IMUPLUS, unit=0x02):
    write(nano, 0x3B, unit)
    write(nano, 0x3D, mode)
    nano.drain(nano.now + 0.1)


def words(nano, register):
    return struct.unpack("<3h", read(nano, register, 6))


def test_boot_takes_400_ms_from_power(nano):
    nano.drain(0.390)
    assert nano.ask(b"t\x00\x01", 0.005)[1] == 0x20
    nano.drain(0.410)
    assert read(nano, 0x00, 4) == b"\xa0\xfb\x32\x0f"


def test_soft_reset_takes_650_ms_and_loses_all(part):
    run_mode(part)
    write(part, 0x3F, 0x20)
    start = part.now
    part.drain(start + 0.63)
    assert part.ask(b"t\x3d\x01", 0.005)[1] == 0x20
    part.drain(start + 0.66)
    assert read(part, 0x3D, 1) == b"\x00"
    assert read(part, 0x3B, 1) == b"\x80"


def test_config_mode_freezes_the_data(part):
    part.set_imu((0, 0, 1.0), (0, 0, 0))
    part.drain(part.now + 0.1)
    assert words(part, GYRO) == (0, 0, 0)
    run_mode(part)
    assert words(part, GYRO) == (0, 0, 900)
    write(part, 0x3D, CONFIG)
    part.drain(part.now + 0.03)
    part.set_imu((0, 0, 2.0), (0, 0, 0))
    part.drain(part.now + 0.1)
    assert words(part, GYRO) == (0, 0, 900)


def test_mode_changes_take_their_time(part):
    write(part, 0x3B, 0x02)
    write(part, 0x3D, IMUPLUS)  # leaves 5 ms of 7 behind it
    part.write(b"t\x3d\x01")
    assert part.drain(part.now + 0.001)[-1] == CONFIG
    part.drain(part.now + 0.005)
    assert read(part, 0x3D, 1) == bytes([IMUPLUS])
    write(part, 0x3D, CONFIG)
    write(part, 0x3B, 0x00)  # too early: not in CONFIG yet
    part.drain(part.now + 0.03)
    assert read(part, 0x3B, 1) == b"\x02"
    write(part, 0x3B, 0x00)
    assert read(part, 0x3B, 1) == b"\x00"


@pytest.mark.parametrize(("unit", "per_gyro", "per_acc"), [
    (0x02, 900, 100), (0x00, 16 * 180 / math.pi, 100), (0x03, 900, 1000 / 9.80665)])
def test_units_scale_the_words(part, unit, per_gyro, per_acc):
    part.set_imu((0.5, -1.0, 2.0), (1.0, -2.0, 3.0))
    run_mode(part, unit=unit)
    assert words(part, GYRO) == pytest.approx([0.5 * per_gyro, -per_gyro, 2 * per_gyro], abs=1)
    assert words(part, LINEAR) == pytest.approx([per_acc, -2 * per_acc, 3 * per_acc], abs=1)


def test_words_saturate_at_the_ranges(part):
    part.set_imu((0, 0, 1e3), (1e3, 0, 0))
    run_mode(part)
    assert words(part, GYRO)[2] == pytest.approx(900 * math.radians(2000), abs=1)
    assert words(part, LINEAR)[0] == pytest.approx(100 * 4 * 9.80665, abs=1)


def test_filters_follow_a_step(part):
    run_mode(part)
    part.set_imu((0, 0, 1.0), (1.0, 0, 0))
    start = part.now
    values = []
    for k in range(1, 60):
        part.drain(start + k * 1e-3)
        values.append(part.imu_register(GYRO + 4) | part.imu_register(GYRO + 5) << 8)
    levels = sorted(set(values))
    assert levels[-1] == 900
    first = next(v for v in levels if v > 0)
    assert first < 900 * (1 - math.exp(-2 * math.pi * 32 * 0.011))
    assert levels == [v for i, v in enumerate(values) if i == 0 or v != values[i - 1]]  # monotone


def test_the_part_has_a_clock_of_its_own(part):
    run_mode(part)
    last = None
    changes = []
    for k in range(1, 4000):
        part.set_imu((0, 0, 1e-3 * k), (0, 0, 0))
        part.drain(0.7 + k * 1e-3)
        now = part.imu_register(GYRO + 4)
        if now != last:
            changes.append(part.now)
        last = now
    period = (changes[-1] - changes[1]) / (len(changes) - 2)
    assert period == pytest.approx(0.01 / 1.0037, rel=2e-4)


def test_offsets_shift_the_output_with_their_last_byte(part):
    write(part, 0x61, 160, 0, 0, 0, 0)  # gyro x 10 deg/s, all but the last byte
    run_mode(part)
    assert words(part, GYRO)[0] == 0
    write(part, 0x3D, CONFIG)
    part.drain(part.now + 0.03)
    write(part, 0x66, 0)
    run_mode(part)
    assert words(part, GYRO)[0] == pytest.approx(-900 * math.radians(10), abs=1)


def test_calibration_levels_rise_and_find_the_zero_error(part):
    part.set_imu_errors(gyro=(0.02, 0, 0), calibrated_after=(-1, 0.5, 1.0))
    run_mode(part)
    assert words(part, GYRO)[0] == 18
    levels = []
    for k in range(12):
        part.drain(0.8 + 0.1 * k)
        status = part.imu_register(0x35)
        levels.append((status >> 4 & 3, status >> 2 & 3, status >> 6))
    assert levels == sorted(levels)
    assert levels[-1] == (3, 3, 0)
    assert abs(words(part, GYRO)[0]) <= 1


def test_stuck_and_garbage(part):
    part.set_imu((0, 0, 1.0), (0, 0, 0))
    run_mode(part)
    part.set_imu_fault("stuck")
    part.set_imu((0, 0, -1.0), (0, 0, 0))
    part.drain(part.now + 0.1)
    assert words(part, GYRO) == (0, 0, 900)
    part.set_imu_fault("garbage")
    part.drain(part.now + 0.05)
    assert words(part, GYRO) != words(part, GYRO)
    part.set_imu_fault("off")
    assert part.ask(b"t\x00\x01")[1] == 0x20
    part.set_imu_fault("ok")
    part.drain(part.now + 0.1)
    assert words(part, GYRO) == (0, 0, -900)


def test_silent_reset_returns_to_config(part):
    run_mode(part)
    part.reset_imu()
    part.drain(part.now + 0.7)
    assert read(part, 0x3D, 1) == b"\x00"
    assert words(part, GYRO) == (0, 0, 0)


def test_falling_back_to_config_makes_no_gap(part):
    """The silent one: it acknowledges all the time, mode and data read 0."""
    part.set_imu((0, 0, 1.0), (0, 0, 0))
    run_mode(part)
    assert words(part, GYRO) == (0, 0, 900)
    part.config_imu()
    assert read(part, 0x3D, 1) == b"\x00"
    part.drain(part.now + 0.1)
    assert words(part, GYRO) == (0, 0, 0)
    run_mode(part)
    assert words(part, GYRO) == (0, 0, 900)


@pytest.mark.parametrize(("fault", "value", "values"), [("wrong", 0.5, 450), ("zero", 1.0, 0)])
def test_wrong_by_a_factor_or_altogether(part, fault, value, values):
    part.set_imu((0, 0, 1.0), (0, 0, 0))
    run_mode(part)
    part.set_imu_fault(fault, value)
    part.drain(part.now + 0.05)
    assert words(part, GYRO) == (0, 0, values)
    part.set_imu_fault("ok")
    part.drain(part.now + 0.05)
    assert words(part, GYRO) == (0, 0, 900)


def test_a_slow_part_updates_at_its_rate(part):
    run_mode(part)
    part.set_imu_fault("slow", 5.0)
    start = part.now
    values = set()
    for k in range(100):
        part.set_imu((0, 0, 1e-2 * k), (0, 0, 0))
        part.drain(start + 0.02 * k)
        values.add(part.imu_register(GYRO + 4) | part.imu_register(GYRO + 5) << 8)
    assert len(values) == pytest.approx(2.0 * 5, abs=1)


def test_a_delayed_part_shows_the_past(part):
    run_mode(part)
    part.set_imu_fault("delayed", 0.2)
    part.drain(part.now + 0.3)
    start = part.now
    part.set_imu((0, 0, 1.0), (0, 0, 0))
    part.drain(start + 0.15)
    assert words(part, GYRO) == (0, 0, 0)
    part.drain(start + 0.28)
    assert words(part, GYRO)[2] == pytest.approx(900, abs=2)


def test_an_intermittent_part_misses_its_share_of_addresses(part):
    part.set_imu_fault("intermittent", 0.3)
    missed = sum(part.ask(b"t\x00\x01", 0.005)[1] == 0x20 for _ in range(300))
    assert missed == pytest.approx(90, abs=30)
