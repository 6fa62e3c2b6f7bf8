"""The ESC's pin of an emulated car whose plans do not come in time any more."""

from __future__ import annotations

from itertools import count
from math import inf

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.mpc import driving
from dart_hal.control.paths import Path
from dart_hal.control.plant import plant_of
from dart_hal.links.base import open_backend
from dart_hal.sim.truth import world_of

NEUTRAL_US, NEAR_US, SETTLED = 1500.0, 5.0, 0.040
SPOILT, AFTER = 1.5, 2.0  # s from the first motion on, s that are looked at


def driven():
    """(why, [(t after the plans ceased [s], pulse [us], true speed [m/s])])."""
    backend = open_backend("sim://?nano=mock&mocap=1")
    world, seen, ceased, ticks = world_of(backend), [], None, count()
    world.watchers.append(lambda channel, pulse: seen.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]), world.truth().v_x)) if channel == 1 else None)

    with Car.over(backend) as car:
        follower = Follower(Path([(12.0, 0.0)], closed=False), plant_of(car.files), 1.0, "ca-mpcc",
                            Rules(here=True))
        car.arm()
        moved = None
        for state in car.states(duration=15.0):
            steering, speed = follower.answer(state.estimate.at(car.now))
            moved = state.t if moved is None and state.speed > 0.1 else moved
            if ceased is None and moved is not None and state.t > moved + SPOILT:
                ceased = world.t
                follower.tracker.mpcc.clock = lambda: float(next(ticks))
            if follower.phase is Phase.ENDED or (ceased and world.t > ceased + AFTER):
                break
            car.drive_speed(steering=steering, speed=speed)
        why = follower.why
        car.stop()
        for _ in car.states(duration=0.3):
            pass
    return why, np.array([(t - ceased, width, v) for t, width, v in seen if t > ceased])


@pytest.mark.more
def test_plans_that_are_late_end_at_neutral():
    """Four late plans are 0.4 s; from there it slows down, and never pulls as it did before."""
    why, rows = driven()
    assert why == "no plan within 0.05 s, 4 times in a row"
    t, width, speed = rows.T
    driving = width[t < 0.3].max()
    assert driving > NEUTRAL_US + 50.0
    assert (width[t > 0.7] < driving - 20.0).all()
    assert speed[-1] < 0.5
    assert (np.abs(width[t > t[-1] - 0.3 + SETTLED] - NEUTRAL_US) <= NEAR_US).all()


@pytest.mark.more
def test_a_tracker_that_forgave_every_late_plan_would_drive_on(monkeypatch):
    """The control."""
    monkeypatch.setattr(driving, "LATEST", inf)
    why, rows = driven()
    assert why == ""
    t, width, _ = rows.T
    assert width[(t > 0.7) & (t < AFTER)].max() > NEUTRAL_US + 50.0
