"""What the ESC gets while ``dart-hal follow`` drives by its lidar and scans end, or fit no map."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.follow import follow, make_follower
from dart_hal.control import follow as rules
from dart_hal.control.follow import MAX_BRIDGED_GAP, MAX_POSE_GAP, Phase, Rules
from dart_hal.control.paths import Path
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.source import LidarPoses
from dart_lab.sim.truth import room_of_car, world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.cli.test_localize_at_pin import Wrong
from tests.common import WAIVED_GATES

RING_PATH = Path([(2.0 * np.pi * 0.8, 1.0 / 0.8)], closed=True)
LOST_AT = 5.0
SLOWS = 0.8
SCAN = 0.2
"""s of the world from which on no scan comes, or none that fits; s in which a car of 1 m/s has
slowed down; s by which the last good pose is older than its arrival, at most."""

pytestmark = pytest.mark.slow


def driven(silent, until=LOST_AT + 9.0):
    """(follower, ESC's neutral [us], pulses (n, 2): t [s], us) of a drive about a circle."""
    backend = open_backend("sim://?seed=0&nano=mock&lidar=1&map=room")
    room = room_of_car(backend)
    world = world_of(backend)
    pulses = []
    world.watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    backend.lidar = Wrong(backend.lidar, LOST_AT, silent=silent)
    with Car.over(backend, poses=LidarPoses(map_of_lines(room.lines), room.start)) as car:
        follower = make_follower(car, RING_PATH, 1.0, "lqr",
                                 Rules(here=True, laps=9, duration=until),
                                 None)
        follow(car, follower, WAIVED_GATES)
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    return follower, neutral, np.array(pulses)


def test_a_lidar_that_falls_silent_is_bridged_then_the_pin_slows_down():
    follower, neutral, pulses = driven(silent=True)
    t, us = pulses.T
    assert follower.phase is Phase.ENDED
    assert "the pose was lost" in follower.why
    bridged = (t > LOST_AT + MAX_POSE_GAP + SCAN) & (t < LOST_AT + MAX_BRIDGED_GAP - SCAN)
    assert us[bridged].mean() > neutral + 20.0
    assert us[t > LOST_AT + MAX_BRIDGED_GAP + SLOWS].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)


def test_scans_that_fit_no_map_are_not_bridged():
    follower, neutral, pulses = driven(silent=False)
    t, us = pulses.T
    assert "the pose was lost" in follower.why
    assert us[t > LOST_AT + MAX_POSE_GAP + SLOWS].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)


def test_control_without_an_end_of_the_bridge_the_pin_drives_on(monkeypatch):
    monkeypatch.setattr(rules, "MAX_BRIDGED_GAP", 1e9)
    _, neutral, pulses = driven(silent=True, until=LOST_AT)
    t, us = pulses.T
    assert us[t > LOST_AT + MAX_BRIDGED_GAP + SLOWS].max() > neutral + 20.0
