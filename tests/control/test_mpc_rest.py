"""Plans of the dynamic bicycle that end at rest: a car stops before a line, and starts again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.control.crossing.speed import safe_speed, sendable_throttle
from dart_hal.control.mpc.iteration import Mpcc, PlanOutcome
from dart_hal.control.mpc.model import linearise, make_stage
from dart_hal.control.paths import Path
from dart_hal.vehicle.sets import PAPER
from studies.control.mpc_loop import Loop, P, limits_of

LINE = 3.0
WAITS = 8.0
"""m; s until the line is gone."""
SETS = {"paper": replace(PAPER, delay=P.delay), "later": P, "steep": replace(P, slip="all_speeds")}
BEND = [(2.0, 0.0), (1.5, 1.0 / 0.75), (4.0, 0.0)]


@pytest.mark.parametrize("name", SETS)
def test_a_slow_car_forgets_a_motion_across_within_a_stage(name):
    p = SETS[name]
    onset = -SETS[name].motor.g
    speeds = np.linspace(-0.02, 0.5, 27)
    states = np.zeros((len(speeds), 8))
    states[:, 3], states[:, 4], states[:, 5], states[:, 6] = speeds, 0.02, 0.04, onset
    after, slopes, _ = linearise(make_stage(p), states, np.tile((onset, 0.0), (len(speeds), 1)))
    assert np.abs(after[:, 4]).max() < 0.005
    assert np.abs(slopes).max() < 2.0, "no state of a stage doubles an error of the one before"


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_it_stops_before_a_line_in_a_bend_and_starts_again(name):
    path = Path(BEND, closed=False)
    mpc = Mpcc(SETS[name], path, lambda s: np.minimum(
        1.0, safe_speed(min(mpc.stop_line, path.length) - s)), limits_of(SETS[name]))
    mpc.stop_line = LINE
    loop = Loop(mpc, learns=False, noise=np.random.default_rng(1))
    stood = 0.0
    while loop.s < 6.5 and loop.car.t < 16.0:
        if loop.car.t > WAITS and not stood:
            stood = loop.s
            mpc.stop_line = np.inf
        loop.planned()
        sent = loop.sent
        loop.sent = sendable_throttle(sent[0], mpc.limits.tau[0]), sent[1]
        loop.move()
        loop.sent = sent
    assert LINE - 0.15 < stood < LINE
    assert loop.s > 6.5
    assert mpc.outcomes[PlanOutcome.DIVERGED] == 0
    assert np.abs(np.array(loop.rows)[:, 2]).max() < 0.05
