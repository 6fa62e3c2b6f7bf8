"""A drive is suggested for a car whose command is a speed."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.flat import with_values
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.suggest import suggest, suggest_parameter_drives
from dart_lab.diagnosis.suggest.library import CHOICES, rehearse_choices
from dart_lab.diagnosis.suggest.virtual import record
from dart_lab.identification.experiment.floor import Floor
from tests.identification.test_speed_loop_fit import FRAME, TRUE, driven

FLOOR = Floor(10.0, 10.0)
OFFERED_DRIVES = ("rollouts", "circles", "launch")


@pytest.fixture(scope="module")
def drives():
    choices = tuple(c for c in CHOICES if c.name in OFFERED_DRIVES)
    return list(rehearse_choices(FLOOR, model_of(TRUE), choices))


@pytest.mark.slow
def test_the_commands_are_speeds_on_the_floor(drives):
    assert [d.choice.name for d in drives] == list(OFFERED_DRIVES)
    for drive in drives:
        assert drive.shell_commands == (), "no program of this package drives such a car"
        for commands in drive.commands:
            assert 0.8 < commands.throttle.max() < 5.0
            run = record(TRUE, commands, FRAME)
            speed = np.hypot(np.gradient(run.mocap.x, run.mocap.t),
                             np.gradient(run.mocap.y, run.mocap.t))
            # The loop is weak: friction holds the car below the command.
            assert 0.5 < speed.max() / commands.throttle.max() < 1.0
            assert np.ptp(run.mocap.x) < FLOOR.length
            assert np.ptp(run.mocap.y) < FLOOR.width


@pytest.mark.slow
def test_a_wrong_gain_gets_a_drive_that_measures_it_better(monkeypatch, drives):
    model = with_values(TRUE, {"motor.gain": 3.0})
    sets = check_inputs([driven(1, 30.0)], [driven(2, 30.0)], model)
    found = diagnose(model_of(model), model, sets.train, sets.test, reference=FRAME,
                     only=("motor_gain",))
    assert found.claims
    for module in ("choose", "sharpen"):
        monkeypatch.setattr(f"dart_lab.diagnosis.suggest.{module}.rehearse_choices",
                            lambda floor, model: iter(drives))
    for one in suggest_parameter_drives(found, model=model_of(model)):
        assert one.drive in OFFERED_DRIVES
        assert all(one.after[name] < one.before[name] for name in one.after)
        assert "drive" in one.sentence()
    suggest(found, model=model_of(model))
