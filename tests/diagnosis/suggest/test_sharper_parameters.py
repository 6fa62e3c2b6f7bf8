"""The drive suggested for a claimed parameter measures it better, by about what it promises."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.suggest import suggest_parameter_drives
from dart_lab.diagnosis.suggest.library import CHOICES, rehearse_choices
from dart_lab.identification.experiment.floor import Floor
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read
from tests.diagnosis import made_by_hand as made

WRONG = replace(PAPER, motor=replace(PAPER.motor, d=1.15 * PAPER.motor.d),
                tyres=replace(PAPER.tyres, rear_cornering_stiffness=0.7
                              * PAPER.tyres.rear_cornering_stiffness))


@pytest.fixture(scope="module")
def diagnosis_and_plan(tmp_path_factory):
    """Of a car with another motor and other rear tyres: the diagnosis, and how to go on."""
    folder = tmp_path_factory.mktemp("sharper")
    file, p = find_model("paper")
    at_hand = [read(write(folder / f"car_1_{i}.csv", WRONG, seed=i, plan=Plan(seconds=30.0)))
               for i in range(2)]

    @cache
    def with_drives(*names):
        drives = [d for d in rehearse_choices(Floor(10.0, 10.0)) if d.choice.name in names]
        new = [read(write(folder / f"car_1_{d.choice.name}.csv", WRONG, seed=70,
                          plan=Plan(series=(d.commands[0].throttle, d.commands[0].steering))))
               for d in drives]
        return diagnose(file, p, [at_hand[0], *new], at_hand[1:], max_causes=0)

    return with_drives


@pytest.mark.long
def test_a_drive_measures_what_it_was_suggested_for(diagnosis_and_plan):
    before = {c.group: c for c in diagnosis_and_plan().claims}
    assert set(before) == {"motor", "rear tyre"}
    suggested = {s.group: s for s in suggest_parameter_drives(diagnosis_and_plan())}
    assert suggested["motor"].enough
    after = {c.group: c for c in diagnosis_and_plan(suggested["motor"].drive).claims}
    for name, promised in suggested["motor"].after.items():
        was = before["motor"].quantities[name]
        found = after["motor"].quantities[name]
        assert promised < 0.5 * was.std
        assert found.std < 0.7 * was.std
        assert found.std < 2.5 * promised


@pytest.mark.long
def test_a_floor_too_small_for_any_drive_is_reported(diagnosis_and_plan):
    for one in suggest_parameter_drives(diagnosis_and_plan(), floor=Floor(1.0, 1.0)):
        if not one.drive:
            assert "fits on this floor" in one.sentence()
            assert one.by_hand
        assert one.to_json()["drive"] in {None, *(c.name for c in CHOICES)}


@pytest.mark.slow
def test_without_a_claim_there_is_nothing_to_sharpen():
    assert suggest_parameter_drives(replace(made.diagnosis(), claims=())) == ()
