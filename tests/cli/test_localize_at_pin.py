"""What the ESC gets while ``dart-hal localize --speed`` drives, and the car gets lost."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.cli.localize import drive_until_ended
from dart_hal.control import while_located
from dart_hal.control.ending import MAX_POSE_GAP, Phase
from dart_hal.control.while_located import WhileLocated
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.source import LidarPoses
from dart_lab.sim.truth import room_of_car, world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.common import WAIVED_GATES

pytestmark = pytest.mark.usefixtures("armed_esc")
POSE_LOST_S = 2.5
SLOWS = 0.8
"""s of the world from which on scans fit no map; s in which a car of 1 m/s has slowed down, with
the scan that was on its way."""


class Wrong:
    """Scans of another source, from a time [s] on of no room, or none at all."""

    trouble = None

    def __init__(self, source, start, *, silent=False):
        self.name = source.name
        self._source = source
        self._start = start
        self._silent = silent

    def poll(self, now):
        scans = self._source.poll(now)
        return [s if s.arrival < self._start else replace(s, distance=np.full(len(s), 0.4))
                for s in scans if s.arrival < self._start or not self._silent]

    def close(self):
        self._source.close()


def driven(start, *, silent=False, duration=inf):
    """(drive, ESC's neutral [us], pulses (n, 2): t [s], us)."""
    backend = open_backend("sim://?seed=0&nano=mock&lidar=1&map=room")
    world = world_of(backend)
    pulses = []
    world.watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL and pulses.append(
        (pulse[1], 1e6 * (pulse[1] - pulse[0]))))
    source = LidarPoses(map_of_lines(room_of_car(backend).lines))
    backend.lidar = Wrong(backend.lidar, start, silent=silent)
    with Car.over(backend, poses=source) as car:
        ended = WhileLocated(1.0, duration)
        drive_until_ended(car, source, ended, 0.3, WAIVED_GATES, [])
        car.stop()
        neutral = car.files.config.throttle.neutral_us
        for _ in car.states(duration=0.3):
            pass
    return ended, neutral, np.array(pulses)


@pytest.mark.slow_except("False")
@pytest.mark.parametrize("silent", [False, True])
def test_the_pin_slows_down_once_the_car_is_lost_and_stays_at_neutral(silent):
    ended, neutral, pulses = driven(POSE_LOST_S, silent=silent)
    t, us = pulses.T
    assert ended.phase is Phase.ENDED
    assert not ended.good
    assert "the pose was lost" in ended.why
    first = t[np.argmax((us > neutral + 5.0) & (t > 0.5))]
    assert 0.8 < first < POSE_LOST_S - 0.5  # it waits until five scans were explained
    late = t > POSE_LOST_S + MAX_POSE_GAP + 0.15
    assert us[late].max() <= us[(t > first) & ~late].max()
    assert us[t > POSE_LOST_S + MAX_POSE_GAP + SLOWS].max() < neutral + 5.0
    assert us[-5:] == pytest.approx(neutral, abs=5.0)    # one count of the PCA9685


@pytest.mark.slow
def test_control_without_patience_that_ends_the_pin_drives_on(monkeypatch):
    monkeypatch.setattr(while_located, "MAX_POSE_GAP", 1e9)
    _, neutral, pulses = driven(POSE_LOST_S, duration=3.5)
    t, us = pulses.T
    assert us[t > POSE_LOST_S + MAX_POSE_GAP + SLOWS].max() > neutral + 20.0


@pytest.mark.slow
def test_a_car_that_is_never_found_never_moves():
    ended, neutral, pulses = driven(0.0)
    t, us = pulses.T
    assert ended.why == "no pose came within 5 s"
    assert us[t > 0.5].max() < neutral + 5.0
