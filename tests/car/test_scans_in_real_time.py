"""A lidar in a world that runs in real time."""

from __future__ import annotations

import pytest

from dart_hal.car import Car


@pytest.mark.realtime
def test_scans_of_a_paced_world():
    with Car.open("sim://?seed=1&nano=mock&lidar=1&pace=1") as car:
        states = list(car.states(duration=1.0))
        assert len(car.lidar.scans()) >= 3
        assert car.lidar.trouble is None
    assert states[-1].scan is not None
    assert 0.0 < states[-1].t - states[-1].scan.t[-1] < 0.5
