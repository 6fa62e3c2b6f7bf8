"""What the ESC gets while ``dart-hal lane`` drives, and its lidar no longer shows a lane."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.lane import drive, make_follower
from dart_hal.control import lane_follow
from dart_hal.control.follow import Phase
from dart_hal.control.lane_follow import MAX_POSE_GAP
from dart_hal.control.stopping import STUCK_TIME
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL

pytestmark = pytest.mark.usefixtures("armed_esc")
LANE_LOST_S = 3.0
SLOW_SPEED = 0.8
"""s of the world from which on the lane is not shown; s in which a car of 1 m/s has slowed down,
with the scan that was on its way."""


def blind(side):
    """A scan without its boards: of the left (1), the right (-1) or both (0)."""
    def change(scan):
        left = np.sin(scan.angle.astype(float)) < 0.0  # an upright X4 counts clockwise
        gone = left if side > 0 else ~left if side < 0 else np.ones(len(scan), dtype=bool)
        return replace(scan, distance=np.where(gone, np.nan, scan.distance))
    return change


SCAN_FAULTS = {"silent": (lambda scan: None, "the lidar is silent"),
               "none": (blind(0), "no boards are visible"),
               "right": (blind(1), "only the right board is visible"),
               "left": (blind(-1), "only the left board is visible")}


class Changed:
    """Scans of another source, from a time [s] on as ``change`` leaves them."""

    trouble = None

    def __init__(self, source, change):
        self.name = source.name
        self._source = source
        self._change = change

    def poll(self, now):
        scans = [s if s.arrival < LANE_LOST_S else self._change(s) for s in self._source.poll(now)]
        return [s for s in scans if s is not None]

    def close(self):
        self._source.close()


def driven(fault, until=inf, blocked=False):
    """(follower, ESC's neutral [us], pulses (n, 2): t [s], us)."""
    backend = open_backend("sim://?seed=3&nano=mock&lidar=1&map=lane")
    world = world_of(backend)
    pulses = []
    world.watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    if blocked:
        world.schedule(3.0, lambda w: setattr(w, "blocked", True))
    else:
        backend.lidar = Changed(backend.lidar, SCAN_FAULTS[fault][0])
    with Car.over(backend) as car:
        follower = make_follower(car, 1.0, inf, until)
        drive(car, follower, ())
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    return follower, neutral, np.array(pulses)


@pytest.mark.slow
@pytest.mark.parametrize("fault", SCAN_FAULTS)
def test_the_pin_slows_down_with_the_lane_and_stays_at_neutral(fault):
    follower, neutral, pulses = driven(fault)
    t, us = pulses.T
    assert follower.phase is Phase.ENDED
    assert not follower.good
    assert SCAN_FAULTS[fault][1] in follower.why
    first = t[np.argmax((us > neutral + 5.0) & (t > 0.5))]
    assert 0.5 < first < LANE_LOST_S - 0.5
    late = t > LANE_LOST_S + MAX_POSE_GAP + 0.15
    assert us[late].max() <= us[(t > first) & ~late].max()
    assert us[t > LANE_LOST_S + MAX_POSE_GAP + SLOW_SPEED].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)  # one count of the PCA9685


@pytest.mark.slow
def test_a_car_that_is_held_is_given_up_at_neutral():
    follower, neutral, pulses = driven("", until=20.0, blocked=True)
    assert not follower.good
    assert "does not move" in follower.why
    t, us = pulses.T
    assert us[(t > 2.5) & (t < 3.5)].max() > neutral + 20.0
    assert us[t > 3.0 + 0.5 + STUCK_TIME].max() < neutral + 5.0


@pytest.mark.slow
def test_control_without_patience_that_ends_the_pin_drives_on(monkeypatch):
    """And without the second bound, the end of what was measured."""
    monkeypatch.setattr(lane_follow, "MAX_POSE_GAP", 1e9)
    monkeypatch.setattr(lane_follow, "FRONT_DISTANCE", -1e9)
    _, neutral, pulses = driven("silent", until=8.0)
    t, us = pulses.T
    assert us[t > LANE_LOST_S + MAX_POSE_GAP + SLOW_SPEED].max() > neutral + 20.0


@pytest.mark.slow
def test_without_patience_it_still_stops_within_what_it_saw(monkeypatch):
    monkeypatch.setattr(lane_follow, "MAX_POSE_GAP", 1e9)
    follower, neutral, pulses = driven("silent")
    assert follower.why == "the lane ends"
    assert pulses[-5:, 1] == pytest.approx(neutral, abs=5.0)
