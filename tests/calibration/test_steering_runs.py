"""Maps from our own runs: dither undone, tyre slip stated, constant levels detected."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.from_recordings import steering_from
from dart_hal.car import Car
from dart_hal.car.runs import remove_dithering
from dart_lab.sim.truth import reveal

LEVELS = (-0.34, -0.25, -0.15, -0.05, 0.05, 0.15, 0.25, 0.3, 0.25, 0.15, 0.05, -0.05, -0.15,
          -0.25, -0.34)
COUNT = 4.88 / 375.0


def test_dither_between_two_counts_is_one_level():
    dithered = np.array([0.3, 0.3 + COUNT / 2, 0.3, 0.3 + COUNT / 2, 0.5, 0.5])
    assert np.allclose(remove_dithering(dithered, COUNT), [0.3 + COUNT / 4] * 4 + [0.5] * 2)


def test_levels_that_differ_by_a_count_stay_separate():
    steps = np.repeat(np.arange(5) * COUNT, 20)
    assert np.allclose(remove_dithering(steps, COUNT), steps)


@pytest.mark.parametrize("speed", [0.5, 1.2])
@pytest.mark.slow
@pytest.mark.long_except("1.2")
def test_the_stated_interval_holds_the_truth_at_any_speed(tmp_path, speed):
    run = tmp_path / "run.mcap"
    with Car.open("sim://?seed=11&nano=mock", cars=tmp_path, record=run) as car:
        car.arm()
        for angle in LEVELS:
            for _ in car.states(duration=2.5):
                car.drive_speed(steering=angle, speed=speed)
    result = steering_from([run])
    truth = reveal(11)["steering"]
    true = np.interp(result.command, truth["command"], truth["angle_rad"])
    inside = np.abs(result.angle - true) < 1.645 * result.angle_std
    assert result.car == "sim-11"
    assert inside.mean() >= 0.8
    assert not any("commands change all the time" in note for note in result.notes)
    if speed > 1.0:
        assert any("tyres slip" in note for note in result.notes)
