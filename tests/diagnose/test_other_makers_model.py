"""The model of another maker as base: another mass, wheelbase and tyre, and no delay at all."""

from __future__ import annotations

from dataclasses import replace

import hidden_drive
import pytest

from dart_hal.diagnose import diagnose
from dart_hal.diagnose.inputs import checked
from dart_hal.recording.dart import read
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.parameters import AxleTyres

THEIRS = replace(
    PAPER, body=replace(PAPER.body, mass=2.1, wheelbase=0.2, l_f=0.1, l_r=0.1, yaw_inertia=0.012),
    tyres=AxleTyres(front_D=0.8, front_C=1.4, front_B=6.0, rear_D=0.9, rear_C=1.4, rear_B=6.0),
    delay=replace(PAPER.delay, steering_s=0.0, throttle_s=0.0, steering_lag_s=0.0,
                  throttle_lag_s=0.0))


def drive(path, seed, seconds):
    return read(hidden_drive.write(path, PAPER, seed, hidden_drive.Plan(seconds=seconds)))


@pytest.mark.more
@pytest.mark.cpu(40)
def test_its_numbers_are_wrong_and_nothing_else_is_named(tmp_path):
    sides = checked([drive(tmp_path / "car_1_a.csv", 5, 60.0)],
                    [drive(tmp_path / "car_1_b.csv", 6, 40.0)], THEIRS)
    assert sides.notes == ()
    found = diagnose(model_of(THEIRS, find_model("paper")[0]), THEIRS, sides.train, sides.test)
    assert found.verdict == "parameters_only"
    assert {"front tyre", "rear tyre", "steering timing"} <= {c.group for c in found.claims}
    late = next(c for c in found.claims if c.group == "steering timing")
    told = late.quantities["delay and lag"]
    d = PAPER.delay
    assert told.after == pytest.approx(1000.0 * (d.steering_s + d.steering_lag_s), abs=25.0)
    assert found.gain["position"].low > 0.8
