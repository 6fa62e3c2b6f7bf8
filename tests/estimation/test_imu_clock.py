"""The age of a gyro sample, found from looks: two clocks that drift past each other."""

from __future__ import annotations

import random
from math import cos, pi, sin, sqrt, tau

import pytest

from dart_hal.estimation import Odometry
from dart_hal.estimation.imu_clock import AGE_STD, LOOK_TIME, NONE, PERIOD, ImuClock

SAME = 2e-3
"""Share of updates that leave all three words of the gyro as they were."""


class ImuPart:
    """An IMU whose clock is faster than the Nano's by ``rate``; times in s.

    lead: from the look to the read; phase: of the first update, in periods.
    """

    def __init__(self, rate: float, phase: float, lead: float = LOOK_TIME, seed: int = 0) -> None:
        self._period = PERIOD * (1.0 - rate)
        self._phase = phase * PERIOD
        self._lead = lead
        self._rng = random.Random(seed)
        self._read = 0.0

    def _updates(self, t: float) -> int:
        return int((t + self._phase) // self._period)

    def read(self, slot: int) -> tuple[float, int, float]:
        """Time of the read, result of the look, true time of the sample."""
        read = slot * PERIOD + self._rng.gauss(0.0, 5e-5)
        counts = [self._updates(t) for t in (self._read, read - self._lead, read)]
        self._read = read
        before, after = (counts[k + 1] > counts[k] and self._rng.random() > SAME for k in (0, 1))
        return read, before | after << 1, counts[2] * self._period - self._phase


def follow_reads(rate: float, phase: float, seconds: float = 60.0, lead: float = LOOK_TIME,
                 seed: int = 0) -> list[tuple[float, float, float]]:
    """(t, error of the sample's time, stated deviation) of each read that saw a change."""
    part = ImuPart(rate, phase, lead, seed)
    clock = ImuClock()
    found = []
    for slot in range(1, round(seconds / PERIOD)):
        read, look, true = part.read(slot)
        times = clock.sample_time(read, look)
        if look != NONE:
            assert times is not None
            found.append((read, times - true, clock.std))
    return found


def rms(values: list[float]) -> float:
    return sqrt(sum(v * v for v in values) / len(values))


@pytest.mark.parametrize("rate", [5e-3, 3e-3, 1.4e-3, 7e-4, -7e-4, -1.4e-3, -3e-3, -5e-3])
@pytest.mark.parametrize("lead", [LOOK_TIME, 3.6e-3], ids=["180 us", "50 us"])
@pytest.mark.slow_except("50 us--0.003", "50 us-0.0007", "180 us-0.005", "180 us--0.0014")
def test_the_age_is_known_after_two_beats(rate, lead):
    """Beats of 2 to 14 s. A look that comes elsewhere than thought costs little."""
    late = [e for t, e, _ in follow_reads(rate, 0.37, lead=lead, seed=3) if t > 30.0]
    assert rms(late) < (0.2e-3 if lead == LOOK_TIME else 0.4e-3)


@pytest.mark.parametrize("rate", [1e-4, 1e-5, 0.0, -1e-5, -1e-4])
@pytest.mark.slow_except("0.0")
def test_of_clocks_in_step_the_half_is_known(rate):
    """The age hardly moves in a minute: within the look's region, and not stated as more exact."""
    scores = [(e / std)**2 for phase in range(5)
              for t, e, std in follow_reads(rate, 0.1 + 0.2 * phase, 20.0) if t > 5.0]
    errors = [e for phase in range(5)
              for t, e, std in follow_reads(rate, 0.1 + 0.2 * phase, 20.0) if t > 5.0]
    assert rms(errors) < AGE_STD
    assert sum(scores) / len(scores) < 3.0


@pytest.mark.slow
def test_stated_deviations_are_honest():
    """30 clocks up to 0.5 % different, at 2 s and later: 1 when honest, they are the same for
    long."""
    rng = random.Random(5)
    scores = []
    for seed in range(30):
        rows = follow_reads(rng.uniform(-5e-3, 5e-3), rng.random(), 12.0, seed=seed)
        scores += [(e / std)**2 for t, e, std in rows if t > 2.0]
    assert 0.1 < sum(scores) / len(scores) < 2.0


def test_without_looks_no_time_is_given():
    clock = ImuClock()
    assert all(clock.sample_time(k * PERIOD, NONE) is None for k in range(100))
    assert all(clock.mean_read(k * PERIOD, NONE) == k * PERIOD for k in range(100, 200))
    assert clock.std == AGE_STD


def test_a_part_that_stops_is_no_longer_followed():
    clock = ImuClock()
    part = ImuPart(2e-3, 0.4)
    for slot in range(1, 1000):
        clock.sample_time(*part.read(slot)[:2])
    assert clock.std < 0.5e-3
    times = [clock.sample_time((1000 + k) * PERIOD, NONE) for k in range(20)]
    assert times[-1] is None
    assert clock.std == AGE_STD


def test_a_part_that_restarts_is_found_again():
    clock = ImuClock()
    part = ImuPart(2e-3, 0.4)
    for slot in range(1, 2000):
        clock.sample_time(*part.read(slot)[:2])
    part = ImuPart(2e-3, 0.9)
    errors = []
    for slot in range(2000, 4000):
        read, look, true = part.read(slot)
        times = clock.sample_time(read, look)
        errors.append(times - true if times is not None and look != NONE else 0.0)
    assert rms(errors[1000:]) < 0.3e-3


def turned_wrong(looks: bool, phase: float, bend: float = 7.0, seconds: float = 60.0) -> float:
    """Yaw error [rad] after a minute of bends that beat with the IMU's clock."""
    part = ImuPart(PERIOD / bend, phase)
    clock = ImuClock()
    odometry = Odometry()

    def yaw(t: float) -> float:
        return -0.8 * bend / tau * cos(tau * t / bend)

    for slot in range(1, round(seconds / PERIOD)):
        read, look, true = part.read(slot)
        rate = 0.8 * sin(tau * (true - 0.005) / bend)
        times = clock.mean_read(read, look if looks else NONE)
        odometry.update(read + 4e-3, slot * PERIOD, 1.0, rate, times, age_std=clock.std)
    end = read + 4e-3
    return odometry.yaw - yaw(end) + yaw(PERIOD)


@pytest.mark.slow
def test_bends_in_step_with_the_beat_do_not_turn_the_car():
    """Without looks up to 60 s of 0.8 tau / 7 rad/s2 at 3.2 ms / sqrt(2) squared: 0.07 rad."""
    phases = 0.0, 0.25, 0.5, 0.75
    assert max(abs(turned_wrong(False, phase)) for phase in phases) > 0.05
    assert max(abs(turned_wrong(True, phase)) for phase in phases) < 0.01


def test_a_known_age_makes_the_yaw_surer():
    """The spread falls with the age's deviation, and not below the gyro's own noise."""
    spread = []
    for age_std in (AGE_STD, 0.1 * AGE_STD):
        odometry = Odometry(gyro_bias_std=1e-9)
        for slot in range(1000):
            t = slot * PERIOD
            odometry.update(t, t, 1.0, sin(pi * t), t - 4e-3, age_std=age_std)
        spread.append(odometry.pose.cov[2, 2])
    assert spread[1] < 0.3 * spread[0]
