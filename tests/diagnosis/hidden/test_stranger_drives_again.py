"""A car of the independent simulator that has driven before drives as a new one: its filters
restart."""

from __future__ import annotations

import numpy as np
import pytest

from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_causes import SIZES, hide
from studies.diagnosis.stranger_files import Habits, record

HOW = Habits(style="steps")
MAX_DISTANCE = 0.3  # m after 12 s; angles and lags may begin where the last drive left them


@pytest.mark.slow
@pytest.mark.parametrize("name", ["throttle_lag", "steering_lag"])
def test_a_second_drive_is_that_of_a_new_car(tmp_path, name):
    ways = []
    for before in (True, False):
        car = Car()
        hide(car, name, SIZES[name][2])
        if before:
            record(tmp_path / "before.csv", car, HOW, 12.0, 1)
        m = read(record(tmp_path / f"{before}.csv", car, HOW, 12.0, 2)).mocap
        ways.append(np.stack([m.x, m.y]))
    assert np.hypot(*(ways[0] - ways[1])).max() < MAX_DISTANCE
