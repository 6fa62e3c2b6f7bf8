"""STATE tuples to SI: counters across wraps and restarts, axes, ages."""

from __future__ import annotations

from itertools import accumulate
from math import inf, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.estimation import FrameReader, Mounting, flag_names
from dart_hal.wire.messages import STATE

VALID_BIT = 1


def state(t=0, count=0, edge=0, dt=0, count_b=0, edge_b=0, acc=(0, 0, 0), gyro=(0, 0, 0),
          age=0, calib=0, flags=VALID_BIT, beat=0):
    """A STATE tuple; raw counters are wrapped to their width."""
    values = (t % 2**32, count % 2**32, edge % 2**32, dt, count_b % 2**16, edge_b % 2**32,
              *acc, *gyro, age, calib, flags, beat)
    return STATE.struct.unpack(STATE.struct.pack(*values))


steps = st.lists(st.tuples(st.integers(1, 2**31 - 1), st.integers(0, 40_000)), min_size=1,
                 max_size=30)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**16 - 1), steps)
def test_counters_are_those_without_a_wrap(t0, c0, b0, steps):
    reader = FrameReader()
    reader.read(state(t=t0, count=c0, count_b=b0), 0.0)
    times = list(accumulate((dt for dt, _ in steps), initial=t0))[1:]
    counts = list(accumulate(dc for _, dc in steps))
    for t, n in zip(times, counts, strict=True):
        sample = reader.read(state(t=t, count=c0 + n, edge=t - 7, count_b=b0 + n), t * 0.5e-6)
        assert not sample.restarted
        assert sample.t_dev == t / 2e6
        assert (sample.ticks, sample.ticks_b) == (c0 + n, b0 + n)
        if n:
            assert sample.edge_t <= sample.t_dev


def test_an_old_edge_stamp_does_not_alias_after_35_minutes():
    reader = FrameReader()
    reader.read(state(t=100, count=1, edge=50), 0.0)
    reader.read(state(t=200, count=2, edge=150), 0.0)
    for k in range(1, 4):
        sample = reader.read(state(t=200 + k * 2**31 - k, count=2, edge=150), k * 1073.7)
    assert sample.edge_t == 150 * 0.5e-6
    assert sample.t_dev > 3000


@pytest.mark.parametrize("uptime", [10.0, 500.0, 1500.0, 2100.0])
@pytest.mark.parametrize("reported", [True, False])
def test_restart_rebases_without_a_jump(uptime, reported):
    reader = FrameReader()
    for k in range(150):
        t = int((uptime + k * 0.01) * 2e6)
        before = reader.read(state(t=t, count=5000 + 5 * k, count_b=k, edge=t), 50.0 + k * 0.01)
    if reported:
        reader.restart()
    after = reader.read(state(t=40_000, count=4, count_b=1, edge=39_000), 53.0)
    assert after.restarted
    assert abs(after.ticks - before.ticks) <= 1
    assert abs(after.ticks_b - before.ticks_b) <= 1
    assert after.t_dev == 0.02
    assert after.edge_t == 0.0195
    later = reader.read(state(t=60_000, count=9, count_b=2, edge=59_000), 53.01)
    assert not later.restarted
    assert later.ticks - after.ticks == 5


def test_a_restart_reported_after_its_first_frame_counts_once():
    reader = FrameReader()
    for k in range(150):
        reader.read(state(t=2_000_000 + 20_000 * k, count=k), 0.01 * k)
    assert reader.read(state(t=20_000, count=1), 3.0).restarted
    reader.restart()
    sample = reader.read(state(t=40_000, count=6), 3.01)
    assert not sample.restarted


def test_a_long_gap_is_no_restart():
    reader = FrameReader()
    reader.read(state(t=0, count=0), 0.0)
    sample = reader.read(state(t=2 * 60_000_000, count=700), 60.0)
    assert not sample.restarted
    assert sample.ticks == 700


def test_scales_ages_and_levels():
    sample = FrameReader().read(
        state(t=2_000_000, dt=2000, acc=(100, -250, 981), gyro=(0, 0, 900), age=1250,
              calib=0b11_10_01_00, beat=42), 0.0)
    assert sample.gyro == pytest.approx((0.0, 0.0, 1.0))
    assert sample.acc == pytest.approx((1.0, -2.5, 9.81))
    assert sample.imu_age == pytest.approx(0.005)
    assert sample.imu_t == pytest.approx(0.995)
    assert sample.edge_dt == pytest.approx(1e-3)
    assert sample.calib == (3, 2, 1, 0)
    assert sample.beat_age == pytest.approx(0.042)


@pytest.mark.parametrize(("flags", "age"), [(0, 100), (VALID_BIT, 65535), (0, 65535)])
def test_no_valid_imu_is_none_never_zero(flags, age):
    sample = FrameReader().read(state(flags=flags, age=age, gyro=(1, 2, 3)), 0.0)
    assert sample.gyro is None
    assert sample.acc is None


def test_looks_are_read_of_firmware_that_has_them():
    """Else the two bits are the magnetometer's level, as version 0.1 sends them."""
    reader = FrameReader()
    old = reader.read(state(calib=0b11_11_11_10), 0.0)
    assert (old.calib, old.look) == ((3, 3, 3, 2), 0)
    reader.has_gyro_look = True
    new = reader.read(state(t=20_000, calib=0b11_11_11_10), 0.01)
    assert (new.calib, new.look) == ((3, 3, 3, 0), 2)


def test_saturated_fields_are_unknown():
    sample = FrameReader().read(state(dt=65535, age=65535, beat=255), 0.0)
    assert sample.edge_dt == 0.0
    assert sample.imu_age == sample.beat_age == inf


@pytest.mark.parametrize(("mounting", "sensor", "body"), [
    (Mounting(yaw=pi / 2), (100, 0, 0), (0.0, 1.0, 0.0)),     # sensor x points left
    (Mounting(roll=pi), (0, 100, 100), (0.0, -1.0, -1.0)),    # upside down
    (Mounting(pitch=pi / 2), (100, 0, 0), (0.0, 0.0, -1.0)),  # sensor x points down
])
def test_mounting_turns_sensor_axes_into_body_axes(mounting, sensor, body):
    sample = FrameReader(mounting).read(state(acc=sensor), 0.0)
    assert sample.acc == pytest.approx(body, abs=1e-12)


def test_gyro_scale_divides_the_reading():
    sample = FrameReader(Mounting(gyro_scale=1.02)).read(state(gyro=(0, 0, 918)), 0.0)
    assert sample.gyro[2] == pytest.approx(1.0)


def test_flag_names():
    assert flag_names(0b1000_0000_0000_0001) == {"IMU_VALID", "MOCK"}
    assert flag_names(0) == frozenset()


def test_a_restart_is_found_by_its_edges_where_the_clock_has_passed_its_old_time():
    """A computer that was stopped for 12 s, in which the board restarted and ran for 9 s."""
    reader = FrameReader()
    reader.read(state(t=5 * 2_000_000, count=2421), 5.0)
    sample = reader.read(state(t=9 * 2_000_000, count=12, edge=8 * 2_000_000), 17.0)
    assert sample.restarted
    assert sample.ticks == 2421
    sample = reader.read(state(t=9 * 2_000_000 + 20_000, count=13), 17.01)
    assert (sample.restarted, sample.ticks) == (False, 2422)
