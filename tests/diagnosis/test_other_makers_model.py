"""The model of another maker as base: another mass, wheelbase and tyre, and no delay at all."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.parameters import AxleTyres
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read

THEIRS = replace(
    PAPER, body=replace(PAPER.body, mass=2.1, wheelbase=0.2, l_f=0.1, l_r=0.1, yaw_inertia=0.012),
    tyres=AxleTyres(front_D=0.8, front_C=1.4, front_B=6.0, rear_D=0.9, rear_C=1.4, rear_B=6.0),
    delay=replace(PAPER.delay, steering_s=0.0, throttle_s=0.0, steering_lag_s=0.0,
                  throttle_lag_s=0.0))


def drive(path, seed, seconds, car):
    return read(hidden_drive.write(path, car, seed, hidden_drive.Plan(seconds=seconds)))


def diagnose_car(folder, car):
    """Of drives of ``car``, by the other maker's model."""
    sides = check_inputs([drive(folder / "car_1_a.csv", 5, 60.0, car)],
                    [drive(folder / "car_1_b.csv", 6, 40.0, car)], THEIRS)
    assert sides.notes == ()
    return diagnose(model_of(THEIRS, find_model("paper")[0]), THEIRS, sides.train, sides.test)


@pytest.mark.slow
def test_its_numbers_are_wrong_and_nothing_else_is_named(tmp_path):
    found = diagnose_car(tmp_path, PAPER)
    assert found.verdict == "parameters_only"
    assert {"front tyre", "rear tyre", "steering timing"} <= {c.group for c in found.claims}
    late = next(c for c in found.claims if c.group == "steering timing")
    timing = late.quantities["delay and lag"]
    d = PAPER.delay
    assert timing.after == pytest.approx(1000.0 * (d.steering_s + d.steering_lag_s), abs=25.0)
    assert found.gain["position"].low > 0.8


@pytest.mark.slow
def test_what_it_lacks_besides_is_named(tmp_path):
    """Control: so many wrong numbers do not take a missing effect along."""
    found = diagnose_car(tmp_path, apply(PAPER, "steering_backlash", k=0.1))
    assert [c.effect for c in found.causes] == ["steering_backlash"]
    assert found.causes[0].parameters["k"].value == pytest.approx(0.1, rel=0.3)
    assert {"front tyre", "rear tyre"} <= {c.group for c in found.claims}
