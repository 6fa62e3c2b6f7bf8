"""What the ESC gets while ``dart-hal follow`` waits, drives, loses its pose and ends."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.follow import follow, follower_of
from dart_hal.control import follow as rules
from dart_hal.control.follow import PATIENCE, Phase, Rules
from dart_hal.control.paths import Path
from dart_hal.links.base import open_backend
from dart_hal.sim.truth import world_of
from dart_hal.sim.world import THROTTLE

LONG = Path([(15.0, 0.0)], closed=False)
LOST_AT, SLOWS = 7.0, 1.0
"""s of the world at which the last pose comes; s in which a car of 1 m/s has slowed down."""


class Until:
    """Poses of another source up to a time [s]."""

    def __init__(self, source, end):
        self.name, self._source, self._end = source.name, source, end

    def poll(self, now):
        return [pose for pose in self._source.poll(now) if pose.arrival < self._end]

    def close(self):
        self._source.close()


def driven(seconds=None):
    """(follower, ESC's neutral [us], pulses (n, 2): t [s], us) of a drive whose poses end."""
    backend = open_backend("sim://?seed=3&nano=mock&mocap=1")
    world, pulses = world_of(backend), []
    world.watchers.append(lambda channel, pulse: channel == THROTTLE and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    with Car.over(backend, poses=Until(backend.poses, LOST_AT)) as car:
        follower = follower_of(car, LONG, 1.0, "lqr", Rules(here=True, duration=seconds or 30.0),
                               None)
        follow(car, follower, ())
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    return follower, neutral, np.array(pulses)


def test_the_pin_slows_down_with_the_pose_and_stays_at_neutral():
    follower, neutral, pulses = driven()
    t, us = pulses.T
    assert follower.phase is Phase.ENDED
    assert "the pose was lost" in follower.why
    first = t[np.argmax(us > neutral + 5.0)]
    assert 0.5 < first < LOST_AT - 1.0
    assert np.abs(us[t < first] - neutral).max() < 5.0  # while it waits and arms
    late = t > LOST_AT + PATIENCE + 0.05
    assert us[late].max() <= us[(t > first) & ~late].max()
    assert us[t > LOST_AT + PATIENCE + SLOWS].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)  # one count of the PCA9685


@pytest.mark.more
def test_control_without_patience_that_ends_the_pin_drives_on(monkeypatch):
    monkeypatch.setattr(rules, "PATIENCE", 1e9)
    _, neutral, pulses = driven(seconds=7.0)
    t, us = pulses.T
    assert us[t > LOST_AT + PATIENCE + SLOWS].max() > neutral + 20.0
