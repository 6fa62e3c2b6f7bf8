"""What the ESC gets while ``dart-hal map`` drives along walls, and the free space ends or is not
measured."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.map import drive_along_walls
from dart_hal.control import lane_follow, wall
from dart_hal.control.follow import Phase
from dart_hal.control.lane_follow import MAX_POSE_GAP
from dart_hal.control.wall import Wall
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.lidar.maps import clearance
from dart_lab.sim.truth import room_of_car, world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.cli.test_lane_at_pin import LANE_LOST_S, SCAN_FAULTS, SLOW_SPEED, Changed
from tests.common import WAIVED_GATES

pytestmark = pytest.mark.usefixtures("armed_esc")


def driven(room, fault="", until=20.0, distance=inf):
    """(follower, neutral [us], pulses (n, 2): t [s], us; least distance [m] from a wall)."""
    backend = open_backend(f"sim://?seed=0&nano=mock&lidar=1&map={room}")
    world = world_of(backend)
    pulses = []
    places = []
    world.watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    if fault:
        backend.lidar = Changed(backend.lidar, SCAN_FAULTS[fault][0])
    with Car.over(backend) as car:
        car.on_state(lambda state: places.append(world.truth()))
        follower = drive_along_walls(car, 0.8, Wall(), distance, until, WAIVED_GATES)
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    found = room_of_car(backend)
    x0, y0, yaw = found.start
    c = np.cos(yaw)
    s = np.sin(yaw)
    near = min(clearance(found.lines, x0 + c * p.x - s * p.y, y0 + s * p.x + c * p.y)
               for p in places[::20])
    return follower, neutral, np.array(pulses), near


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["silent", "none"])
def test_the_pin_is_at_neutral_soon_after_the_lidar_shows_nothing(fault):
    follower, neutral, pulses, _ = driven("corridor", fault)
    t, us = pulses.T
    assert follower.phase is Phase.ENDED
    assert not follower.good
    assert follower.why.startswith("the lidar is silent" if fault == "silent" else
                                   "the route is blocked")
    first = t[np.argmax((us > neutral + 5.0) & (t > 0.5))]
    assert 0.5 < first < LANE_LOST_S - 0.5
    assert us[(t > first + 0.5) & (t < LANE_LOST_S)].min() > neutral + 5.0
    assert us[t > LANE_LOST_S + MAX_POSE_GAP + SLOW_SPEED].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)


@pytest.mark.slow
def test_control_without_patience_and_end_the_pin_drives_on(monkeypatch):
    monkeypatch.setattr(lane_follow, "MAX_POSE_GAP", 1e9)
    monkeypatch.setattr(lane_follow, "FRONT_DISTANCE", -1e9)
    _, neutral, pulses, _ = driven("corridor", "silent", until=8.0)
    t, us = pulses.T
    assert us[t > LANE_LOST_S + MAX_POSE_GAP + SLOW_SPEED].max() > neutral + 20.0


@pytest.mark.slow
def test_it_touches_nothing_in_a_room_and_does_where_it_may(monkeypatch):
    """The negative control: a car that takes itself for a point."""
    follower, neutral, pulses, near = driven("room", until=30.0)
    assert follower.good
    assert near > 0.2
    assert pulses[-5:, 1] == pytest.approx(neutral, abs=5.0)
    monkeypatch.setattr(wall, "MIN_CLEARANCE", 0.0)
    monkeypatch.setattr(wall, "TARGET_CLEARANCE", 0.0)
    *_, near = driven("room", until=30.0)
    assert near < 0.15
