"""A source whose clock is set: stamps as if it had not been; a slow network is no such clock."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses.clock_steps import ClockStepFilter

RATE = 100.0


def run_filter(stamps, arrivals):
    """(clock, [(time of measurement, error of the offset)] of the poses that were let through)."""
    clock, out = ClockStepFilter(), []
    for t, (stamp, arrival) in enumerate(zip(stamps, arrivals, strict=True)):
        pose = clock.correct(ExternalPose(stamp, arrival, 0.0, 0.0, 0.0))
        if pose is not None:
            out.append((t / RATE, pose.stamp - t / RATE - 50.0))
    return clock, np.array(out)


def draw_arrivals(seed, seconds=20.0):
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * RATE)) / RATE
    return rng, t, np.maximum.accumulate(t + 0.005 + rng.exponential(0.003, len(t)))


@pytest.mark.parametrize("step", [-1.0, -0.2, 0.2, 1.0])
@pytest.mark.slow
def test_a_clock_that_is_set_goes_on(step):
    worst = []
    for seed in range(10):
        _, t, arrivals = draw_arrivals(seed)
        clock, out = run_filter(50.0 + t + step * (t > 10.0), arrivals)
        assert clock.steps == 1
        worst.append(np.abs(out[:, 1]).max())
        assert len(out) >= len(t) - 35  # held back for 0.3 s at most
    assert max(worst) < 0.02


def test_a_clock_that_is_set_while_the_car_is_hidden_is_held_for_three_seconds():
    _, t, arrivals = draw_arrivals(1)
    visible = (t < 8.0) | (t > 10.0)
    clock, out = ClockStepFilter(), []
    for k in np.flatnonzero(visible):
        pose = clock.correct(ExternalPose(50.0 + t[k] - 0.5 * (t[k] > 9.0), arrivals[k], 0, 0, 0))
        if pose is not None:
            out.append((t[k], pose.stamp - t[k] - 50.0))
    assert clock.steps == 1
    assert np.abs(np.array(out)[:, 1]).max() < 0.02
    assert any(at > 13.1 for at, _ in out)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bursts", "congestion"])
def test_a_slow_network_is_no_clock_that_was_set(kind):
    for seed in range(30):
        rng, t, arrivals = draw_arrivals(seed)
        if kind == "bursts":
            for at in rng.uniform(1.0, 19.0, 8):
                stop = at + rng.uniform(0.05, 0.4)  # nothing passes, then all at once
                arrivals = np.where((arrivals > at) & (arrivals < stop), stop, arrivals)
        else:
            slow = (t > 8.0) & (t < 15.0)
            arrivals = arrivals + slow * (0.12 + rng.uniform(0.0, 0.06, len(t)))
        arrivals = np.maximum.accumulate(arrivals)
        clock, out = run_filter(50.0 + t, arrivals)
        assert clock.steps == 0
        assert np.abs(out[:, 1]).max() < 1e-6
        if kind == "congestion":
            assert len(out) > len(t) - 20  # late poses are poses
