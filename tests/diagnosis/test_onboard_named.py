"""From sensors alone: what is hidden is named, and nothing where nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.run import diagnose
from tests.diagnosis.onboard_files import record_onboard

NEAR = ("quadratic_drag", "rolling_resistance", "motor_deadband", "encoder_scale", "throttle_lag")


def diagnose_onboard(folder, p, seed, only=(), seconds=(60.0, 40.0)):
    file, base = find_model("paper")
    train, test = ([record_onboard(folder, p, seed + 50 * i, s)] for i, s in enumerate(seconds))
    sides = check_inputs(train, test, base)
    return diagnose(file, base, sides.train, sides.test, refit=False, only=only)


@pytest.mark.long
def test_nothing_is_named_where_nothing_is_hidden(tmp_path):
    found = diagnose_onboard(tmp_path, PAPER, 31)
    assert found.verdict == "nothing_wrong"
    assert not found.causes
    assert not found.unexplained


@pytest.mark.slow
def test_a_cause_in_the_car_is_named_before_its_like(tmp_path):
    """With the negative control: no other name becomes the right one, at any size."""
    found = diagnose_onboard(tmp_path, apply(PAPER, "rolling_resistance", k=0.25), 33, NEAR)
    first = found.causes[0]
    assert first.effect == "rolling_resistance"
    assert first.parameters["k"].value == pytest.approx(0.25, rel=0.2)
    assert first.gain.low > 0.3
    others = [g for name, g in found.ranking.items() if name != first.effect]
    assert max(others) < found.ranking[first.effect] - 15.0


@pytest.mark.slow
def test_a_cause_in_a_sensor_is_named_though_the_model_starts_from_that_sensor(tmp_path):
    found = diagnose_onboard(tmp_path, apply(PAPER, "encoder_scale", k=0.04), 33, NEAR)
    assert [c.effect for c in found.causes] == ["encoder_scale"]
    # only motor and friction determine the speed of the car: 0.032 here, a fifth too low
    assert found.causes[0].parameters["k"].value == pytest.approx(0.04, rel=0.25)
    assert found.causes[0].gain.channel == "encoder"
    assert found.causes[0].gain.low > 0.0


@pytest.mark.slow
def test_parameters_that_a_drive_does_not_determine_are_not_called_found(tmp_path):
    """A refit that predicts the other drive worse is no explanation, and that is reported."""
    file, base = find_model("paper")
    misled, turning = (record_onboard(tmp_path, PAPER, seed, 40.0) for seed in (35, 36))
    sides = check_inputs([misled], [turning], base)
    # A steering command that is held: the check of the inputs would call it another car.
    m = sides.train[0].messages
    held = replace(m, steering=np.full(len(m.steering), 0.6))
    found = diagnose(file, base, [replace(sides.train[0], messages=held)], sides.test,
                     max_causes=0)
    assert found.verdict != "parameters_only"
    assert any("worse" in note and "yaw rate" in note for note in found.notes)
