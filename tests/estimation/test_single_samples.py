"""Which single samples of an IMU are motion: laws of the filter, sample by sample."""

from __future__ import annotations

import math
import random

import pytest

from dart_hal.estimation.single_samples import MIN_RATE_JUMP, SingleSampleFilter

SAMPLE_PERIOD = 0.01
"""s between two samples."""
GYRO_STD = 4e-3
"""rad/s in one sample of the BNO055."""


def accept_all(values: list[float]) -> tuple[list[float], SingleSampleFilter]:
    """The accepted samples in the order of their time, and the filter."""
    channel = SingleSampleFilter(MIN_RATE_JUMP)
    accepted: dict[float, float] = {}
    for k, value in enumerate(values):
        result = channel.add(k * SAMPLE_PERIOD, value, k * SAMPLE_PERIOD)
        if result.withheld_sample is not None:
            accepted[result.withheld_sample[0]] = result.withheld_sample[1]
        accepted[result.stamp] = result.value
    return [accepted[t] for t in sorted(accepted)], channel


def noisy(values: list[float], seed: int = 1) -> list[float]:
    rng = random.Random(seed)
    return [value + rng.gauss(0.0, GYRO_STD) for value in values]


def step(height: float) -> list[float]:
    return [0.0] * 20 + [height] * 20


def decaying_bump() -> list[float]:
    """A kerb: the car yaws to and fro at 15 Hz and comes to rest within 0.2 s."""
    times = [k * SAMPLE_PERIOD for k in range(40)]
    return [0.0] * 20 + [3.0 * math.exp(-t / 0.08) * math.sin(30 * math.pi * t) for t in times]


def collision() -> list[float]:
    """A yaw rate that reverses within one sample and stays."""
    return [2.0] * 20 + [-0.4] * 20


def slalom() -> list[float]:
    return [2.5 * math.sin(2 * math.pi * 1.5 * k * SAMPLE_PERIOD) for k in range(100)]


def pulse_of_the_brake() -> list[float]:
    """One PWM frame of 20 ms behind the low-pass of 32 Hz."""
    return [0.0] * 20 + [0.6, 0.9, 0.12, 0.02] + [0.0] * 20


MOTIONS = {"step": step(1.0), "small step": step(0.2), "bump": decaying_bump(),
           "collision": collision(), "slalom": slalom(), "brake": pulse_of_the_brake()}


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("motion", MOTIONS)
def test_motion_is_accepted_sample_by_sample(motion, noise):
    values = noisy(MOTIONS[motion]) if noise else MOTIONS[motion]
    accepted, channel = accept_all([*values, values[-1]])
    assert channel.rejected == 0
    assert accepted[:len(values)] == values


@pytest.mark.parametrize(("motion", "size"), [
    ("step", 0.06), ("step", 0.3), ("slalom", 0.3), ("slalom", -2.2), ("collision", 2.2)])
def test_single_sample_that_returns_is_rejected(motion, size):
    """In every place except next to the motion's own jump. Control: the same as a lasting
    offset."""
    clean = MOTIONS[motion]
    places = [k for k in range(3, len(clean) - 2)
              if max(abs(clean[k + n] - clean[k + n - 1]) for n in (-1, 0, 1, 2)) < 0.4 * abs(size)]
    assert len(places) > 10
    for place in places:
        values = list(clean)
        values[place] += size
        accepted, channel = accept_all([*values, values[-1]])
        assert channel.rejected == 1
        assert values[place] not in accepted
        lasting = [value + size * (k >= place) for k, value in enumerate(clean)]
        assert accept_all([*lasting, lasting[-1]])[1].rejected == 0


def test_withheld_sample_counts_one_sample_late():
    channel = SingleSampleFilter(MIN_RATE_JUMP)
    for k in range(10):
        channel.add(k * SAMPLE_PERIOD, 0.0, k * SAMPLE_PERIOD)
    first = channel.add(0.10, 1.0, 0.10)
    assert (first.value, first.stamp) == (0.0, 0.09)
    assert channel.add(0.10, 1.0, 0.10) == first, "the same sample decides nothing"
    second = channel.add(0.11, 1.1, 0.11)
    assert second.withheld_sample == (0.10, 1.0)
    assert (second.value, second.stamp) == (1.1, 0.11)


def test_sample_before_a_pause_is_motion():
    """After 40 ms a true motion may have come and gone. Control: the next sample, 10 ms later."""
    for pause, motion in ((0.04, True), (0.01, False)):
        channel = SingleSampleFilter(MIN_RATE_JUMP)
        for k in range(10):
            channel.add(k * SAMPLE_PERIOD, 0.0, k * SAMPLE_PERIOD)
        channel.add(0.10, 1.0, 0.10)
        result = channel.add(0.10 + pause, 0.0, 0.10 + pause)
        assert (result.withheld_sample is not None) == motion
        assert channel.rejected == (not motion)


def test_noise_alone_is_never_rejected_and_sets_the_threshold():
    quiet = SingleSampleFilter(MIN_RATE_JUMP)
    sample_filter = SingleSampleFilter(MIN_RATE_JUMP)
    rng = random.Random(3)
    for k in range(3000):
        quiet.add(k * SAMPLE_PERIOD, rng.gauss(0.0, GYRO_STD), k * SAMPLE_PERIOD)
        sample_filter.add(k * SAMPLE_PERIOD, rng.gauss(0.0, 20 * GYRO_STD), k * SAMPLE_PERIOD)
    assert quiet.rejected == quiet.pairs == 0
    assert quiet.threshold == MIN_RATE_JUMP
    assert sample_filter.threshold == pytest.approx(6 * 20 * GYRO_STD, rel=0.2)
    assert sample_filter.rejected < 0.01 * 3000


def sum_of_residuals(size: float, run: int) -> tuple[float, SingleSampleFilter]:
    """Sum [rad] over 20 s in which `run` of 20 samples are wrong by `size`, and the filter."""
    channel = SingleSampleFilter(MIN_RATE_JUMP)
    rng = random.Random(5)
    total = 0.0
    for k in range(2000):
        value = rng.gauss(0.0, GYRO_STD) + size * (k % 20 < run)
        total += channel.add(k * SAMPLE_PERIOD, value, k * SAMPLE_PERIOD).residual
    return total, channel


@pytest.mark.parametrize(("size", "run", "share"), [
    (0.01, 1, 0.4), (0.02, 1, 0.6), (0.01, 2, 0.25), (0.5, 2, 0.9)])
def test_what_is_accepted_wrongly_is_in_the_residual(size, run, share):
    """Below the threshold, or two in a row: the residuals add up to the error of the turn.

    Control: without wrong samples they add up to next to nothing.
    """
    error = 100 * run * size * SAMPLE_PERIOD
    clean, _ = sum_of_residuals(0.0, run)
    total, channel = sum_of_residuals(size, run)
    assert abs(clean) < 0.1 * error
    assert share * error < total - clean < 1.1 * error
    assert channel.rejected < 5
    assert channel.pairs == pytest.approx(100 if size == 0.5 else 0, abs=1)


def test_single_samples_beyond_the_threshold_leave_no_residual():
    total, channel = sum_of_residuals(0.5, 1)
    clean, _ = sum_of_residuals(0.0, 1)
    assert channel.rejected == 99, "the first comes before there is a sample to compare with"
    assert total == pytest.approx(clean, abs=2e-3)
