"""What the ESC gets while ``dart-hal follow`` waits, drives, loses its pose and ends."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.follow import follow, make_follower
from dart_hal.control import follow as rules
from dart_hal.control import stopping
from dart_hal.control.follow import MAX_BRIDGED_GAP, Phase, Rules
from dart_hal.control.paths import Path
from dart_hal.core.errors import Disarmed
from dart_hal.devices.actuation.neutral_watch import NeutralWatch
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL

LONG_PATH = Path([(15.0, 0.0)], closed=False)
pytestmark = pytest.mark.usefixtures("armed_esc")
POSES_LOST_S = 3.0
SLOW_SPEED_MS = 1.0
"""s of the world at which the last pose comes; s in which a car of 1 m/s has slowed down."""


ROLLS = 0.5
"""m/s that the car keeps, downhill and at neutral."""


class NeverEnds(Exception):
    """The verb still drives at a time at which it must not."""


class Until:
    """Poses of another source up to a time [s]."""

    on_board = False

    def __init__(self, source, end):
        self.name = source.name
        self._source = source
        self._end = end

    def poll(self, now):
        return [pose for pose in self._source.poll(now) if pose.arrival < self._end]

    def close(self):
        self._source.close()


def driven(seconds=None, downhill=False, until=60.0, blocked=False, lost_at=POSES_LOST_S):
    """(follower, ESC's neutral [us], pulses (n, 2): t [s], us) of a drive whose poses end.

    Raises NeverEnds where it goes on at ``until`` s of the world.
    """
    backend = open_backend("sim://?seed=3&nano=mock&mocap=1")
    world = world_of(backend)
    pulses = []
    world.schedule(until, never_ends)
    if blocked:
        world.schedule(1.0, lambda w: setattr(w, "blocked", True))
    if downhill:
        world.schedule(0.0, roll)
    world.watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    with Car.over(backend, poses=Until(backend.poses, lost_at)) as car:
        follower = make_follower(car, LONG_PATH, 1.0, "lqr",
                                 Rules(here=True, duration=seconds or 30.0),
                                 None)
        follow(car, follower, ())
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    return follower, neutral, np.array(pulses)


@pytest.mark.slow
def test_the_pin_slows_down_with_the_pose_and_stays_at_neutral():
    follower, neutral, pulses = driven()
    t, us = pulses.T
    assert follower.phase is Phase.ENDED
    assert "the pose was lost" in follower.why
    first = t[np.argmax(us > neutral + 5.0)]
    assert 0.5 < first < POSES_LOST_S - 1.0
    assert np.abs(us[t < first] - neutral).max() < 5.0  # while it waits and arms
    late = t > POSES_LOST_S + MAX_BRIDGED_GAP + 0.05
    assert us[late].max() <= us[(t > first) & ~late].max()
    assert us[t > POSES_LOST_S + MAX_BRIDGED_GAP + SLOW_SPEED_MS].max() < neutral + 5.0
    bridged = (t > POSES_LOST_S + 0.5) & (t < POSES_LOST_S + MAX_BRIDGED_GAP)
    assert us[bridged].max() > neutral + 5.0, "the estimate is certain: it drives on"
    assert us[-5:] == pytest.approx(neutral, abs=5.0)  # one count of the PCA9685


def roll(world):
    if world.distance > 0.2:
        world.motion.v_x = max(world.motion.v_x, ROLLS)
    world.schedule(world.t + 0.005, roll)


def never_ends(world):
    raise NeverEnds(f"{world.motion.v_x:.1f} m/s")


@pytest.mark.slow
def test_a_car_that_rolls_away_gets_no_pulse():
    """It does not slow down at neutral: the drive ends with that name."""
    with pytest.raises(Disarmed, match="MOVES_AT_NEUTRAL"):
        driven(2.8, downhill=True, until=8.0)


def test_a_car_that_rolls_away_is_given_up_at_neutral(monkeypatch):
    """Without the layer before, its drive ends by the time that a stop may take, and says that the
    car did not stop."""
    monkeypatch.setattr(NeutralWatch, "update", lambda *_: False)
    follower, neutral, pulses = driven(2.8, downhill=True, until=8.0)
    assert follower.phase is Phase.ENDED
    assert not follower.good
    assert "it still rolls at" in follower.why
    t, us = pulses.T
    assert t[-1] - t[us > neutral + 5.0].max() > stopping.MAX_ROLL_TIME  # neutral all the while
    assert pulses[-5:, 1] == pytest.approx(neutral, abs=5.0)


@pytest.mark.slow
def test_control_without_that_time_it_never_ends(monkeypatch):
    monkeypatch.setattr(stopping, "MAX_ROLL_TIME", 1e9)
    monkeypatch.setattr(NeutralWatch, "update", lambda *_: False)
    with pytest.raises(NeverEnds):
        driven(2.8, downhill=True, until=8.0)


@pytest.mark.slow
def test_a_car_that_is_held_is_given_up_at_neutral():
    """Its motor pulls against what holds the wheel for the time in which a car has to move."""
    follower, neutral, pulses = driven(60.0, blocked=True, until=10.0, lost_at=5.0)
    assert follower.phase is Phase.ENDED
    assert not follower.good
    assert "does not move" in follower.why
    t, us = pulses.T
    assert us[(t > 1.5) & (t < 3.5)].max() > neutral + 20.0
    assert us[t > 1.0 + 0.5 + stopping.STUCK_TIME].max() < neutral + 5.0


@pytest.mark.slow
def test_control_without_that_time_it_pulls_for_ever(monkeypatch):
    monkeypatch.setattr(stopping, "STUCK_TIME", 1e9)
    monkeypatch.setattr(rules, "MAX_BRIDGED_GAP", 1e9)
    monkeypatch.setattr(rules, "MAX_POSE_GAP", 1e9)
    with pytest.raises(NeverEnds):
        driven(60.0, blocked=True, until=10.0, lost_at=5.0)


@pytest.mark.slow
def test_control_without_patience_that_ends_the_pin_drives_on(monkeypatch):
    monkeypatch.setattr(rules, "MAX_BRIDGED_GAP", 1e9)
    monkeypatch.setattr(rules, "MAX_POSE_GAP", 1e9)
    _, neutral, pulses = driven(seconds=7.0)
    t, us = pulses.T
    assert us[t > POSES_LOST_S + MAX_BRIDGED_GAP + SLOW_SPEED_MS].max() > neutral + 20.0
