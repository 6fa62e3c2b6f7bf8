"""A motion capture of a world that runs in real time: poses come, from a world that others move."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.core.types import Tracking


@pytest.mark.realtime
def test_poses_of_a_paced_world():
    with Car.open("sim://?seed=1&nano=mock&mocap=1&pace=1") as car:
        states = list(car.states(duration=0.5))
    last = states[-1].external
    assert last is not None
    assert last.tracking is Tracking.TRACKING
