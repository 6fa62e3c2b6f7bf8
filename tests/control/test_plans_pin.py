"""The ESC's pin of an emulated car whose plans fail while it drives."""

from __future__ import annotations

from itertools import count
from math import inf, nan

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.mpc import driving, tracker
from dart_hal.control.mpc.obstacles import Obstacle
from dart_hal.control.mpc.planner import PlanOutcome
from dart_hal.control.paths import Path
from dart_hal.control.plant import plant_of
from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

PULSE_DELAY_S = 0.040
# s from the first motion on, s that are looked at
SPOILT = 1.5
SPOILT_AFTER_S = 2.0
GONE = 0.75  # s: up to five periods of a plan, and 0.25 s at 2 m/s2: it requests half the speed
LATE_PLAN_MESSAGE = "no plan within 0.05 s, 4 times in a row"


def late(mpcc):
    """Each look at the clock takes a second."""
    ticks = count()
    mpcc.clock = lambda: float(next(ticks))


def place_disc(mpcc):
    """A disc in the middle, 2.5 m ahead."""
    mpcc.obstacles = (Obstacle(mpcc.last.s[0] + 2.5, 0.0, 0.25),)


def return_nan_states(mpcc):
    """States that are no numbers."""
    plan = mpcc.plan
    mpcc.plan = lambda t, state, *rest: plan(t, nan * state, *rest)


def driven(name, spoil):
    """(follower, [(t after the plans ceased [s], pulse [us], true speed [m/s])], ranks that were
    reported of plans)."""
    backend = open_backend("sim://?nano=mock&mocap=1")
    world = world_of(backend)
    pulses = []
    ceased = None
    outcomes = []
    world.watchers.append(lambda channel, pulse: pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]), world.truth().v_x)) if channel == 1 else None)
    with Car.over(backend) as car:
        follower = Follower(Path([(12.0, 0.0)], closed=False), plant_of(car.files), 1.0, name,
                            Rules(here=True))
        car.arm()
        moved = None
        for state in car.states(duration=15.0):
            steering, speed = follower.answer(state.estimate.predict(car.now))
            outcomes.extend(follower.tracker.plan_log.get("outcome", ()))
            moved = state.t if moved is None and state.speed > 0.1 else moved
            if ceased is None and moved is not None and state.t > moved + SPOILT:
                ceased = world.t
                spoil(follower.tracker.mpcc)
            if follower.phase is Phase.ENDED or (ceased and world.t > ceased + SPOILT_AFTER_S):
                break
            car.drive_speed(steering=steering, speed=speed)
        car.stop()
        for _ in car.states(duration=0.3):
            pass
    return follower, np.array([(t - ceased, width, v) for t, width,
                               v in pulses if t > ceased]), outcomes


@pytest.mark.slow
@pytest.mark.parametrize(("name", "spoil", "why", "outcome"), [
    ("mpcc", late, LATE_PLAN_MESSAGE, PlanOutcome.LATE),
    ("ca-mpcc", late, LATE_PLAN_MESSAGE, PlanOutcome.LATE),
    ("mpcc", place_disc, "obstacles leave no way within the lane", PlanOutcome.BLOCKED),
    ("mpcc", return_nan_states, "the plan diverged", PlanOutcome.DIVERGED)])
def test_a_drive_without_plans_ends_at_neutral(name, spoil, why, outcome):
    """Four late plans are 0.4 s; from there it slows down, and never pulls as it did before. What
    it was is counted, and reported for the recording."""
    follower, rows, outcomes = driven(name, spoil)
    assert follower.why == why
    assert follower.tracker.mpcc.outcomes[outcome] == (4 if outcome is PlanOutcome.LATE else 1)
    assert outcomes[-1] == tracker.PLAN_OUTCOMES.index(outcome)
    assert outcomes[0] == tracker.PLAN_OUTCOMES.index(PlanOutcome.SOLVED)
    t, width, speed = rows.T
    driving = width[t < 0.1].max()
    assert driving > NEUTRAL_US + 50.0
    assert (width[t > GONE] < driving - 20.0).all()
    assert speed[-1] < 0.5
    assert (np.abs(width[t > t[-1] - 0.3 + PULSE_DELAY_S]
                   - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mpcc", "ca-mpcc"])
def test_a_tracker_that_forgave_every_late_plan_would_drive_on(name, monkeypatch):
    """The control."""
    monkeypatch.setattr(driving, "MAX_LATE_PLANS", inf)
    follower, rows, _ = driven(name, late)
    assert follower.why == ""
    t, width, _ = rows.T
    assert width[(t > GONE) & (t < SPOILT_AFTER_S)].max() > NEUTRAL_US + 50.0


def start_off_path(offset):
    """(follower or the refusal, [(t, us)]) of a car at rest so many m off the path."""
    backend = open_backend("sim://?nano=mock")
    pulses = []
    world_of(backend).watchers.append(lambda channel, pulse: pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))) if channel == 1 else None)
    with Car.over(backend) as car:
        path = Path([(6.0, 0.0)], closed=False, start=(0.0, offset, 0.0))
        follower = Follower(path, plant_of(car.files), 1.0, "mpcc",
                                   Rules(odometry=True))
        armed = False
        try:
            for state in car.states(duration=15.0):
                steering, speed = follower.answer(state.estimate.predict(car.now))
                if follower.phase is Phase.ENDED:
                    break
                if not armed:
                    armed = True
                    car.arm()
                car.drive_speed(steering=steering, speed=speed)
        except UsageError as why:
            follower = why
        car.stop()
        for _ in car.states(duration=0.3):
            pass
    return follower, np.array(pulses)


@pytest.mark.slow
def test_a_start_outside_the_lane_comes_into_it_and_ends_at_neutral():
    follower, pulses = start_off_path(0.5)
    assert follower.why == "the path is driven"
    offset = follower.driven.table[:, 3]
    assert abs(offset[0]) > 0.45
    assert abs(offset[-1]) < 0.03
    t, width = pulses.T
    assert width.max() > NEUTRAL_US + 50.0
    assert (np.abs(width[t > t[-1] - 0.3 + PULSE_DELAY_S]
                   - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US).all()


def test_one_that_is_further_away_never_drives():
    refused, pulses = start_off_path(1.2)
    assert "1.20 m away from the path" in str(refused)
    assert (np.abs(pulses[:, 1] - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US).all()
