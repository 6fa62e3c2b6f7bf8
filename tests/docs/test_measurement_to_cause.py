"""The walk "from a recording to a named cause" is what a diagnosis does.

A small diagnosis runs under a tracer that writes down in which order the functions of
the page are called for the first time.
"""

from __future__ import annotations

import pytest
from walks import MAX_STEPS, find_object, first_calls, steps

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model
from studies.diagnosis import hidden_drive

HEADING = "From a recording to a named cause"


def test_there_are_at_most_ten():
    assert 5 <= len(steps(HEADING)) <= MAX_STEPS


def test_a_name_that_is_gone_is_detected():
    with pytest.raises(AttributeError):
        find_object("dart_lab.diagnosis.run.diagnosis")


@pytest.mark.slow
def test_a_diagnosis_calls_them_in_this_order(tmp_path):
    car = apply(PAPER, "gyro_scale", k=0.1)
    files = [hidden_drive.write(tmp_path / f"car_1_{seed}.csv", car, seed=seed,
                                plan=hidden_drive.Plan(seconds=40.0)) for seed in (1, 2)]
    found = []

    def work():
        train, test = (find_object("dart_hal.car.runs.read_any")([f])[0] for f in files)
        found.append(find_object("dart_lab.diagnosis.run.diagnose")(
            *find_model("paper"), train, test, refit=False, only=("gyro_scale", "grip")))

    assert first_calls(steps(HEADING), work) == steps(HEADING)
    assert [c.effect for c in found[0].causes] == ["gyro_scale"]


def test_another_order_is_detected():
    def work():
        find_model("paper")
        find_object("dart_hal.vehicle.effects.parse_effects")("gyro_scale:0.1")

    order = ["dart_hal.vehicle.load.find_model", "dart_hal.vehicle.effects.parse_effects"]
    assert first_calls(order[::-1], work) == order
