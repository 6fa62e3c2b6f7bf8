"""One drive at the sizes 1:43, 1:10 and 1:1: the same causes are found, of the same relative size.

The forces of the small car are a fortieth of those of 1:10, those of the large one 600 times. With
the thresholds of 1:10 for all, neither has its rolling resistance named.
"""

from __future__ import annotations

import msgspec
import pytest

from dart_hal.core.config import Quantity
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.sizes import set_sizes
from dart_lab import identify
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from tests.diagnosis.scaled_drive import CAR_SIZES, log, simulate

STATED_ERROR = 0.03  # standard error of a parameter of the model, relative to its value
STATED_TRIM = 0.005  # standard error of the command straight on
STATED_DELAY = 0.005  # s, standard error for the car of 1:10
# Relative error of a size that is found: the refit of the model follows a part of each cause.
MAX_ERROR = 0.3
MAX_DEVIATION = 2.6  # standard errors: 99 % of a normal distribution


def state_errors(model, size):
    """The model file with standard errors, as after a fit."""
    groups = {}
    for group in ("friction", "motor", "steering", "tyres", "delay"):
        entries = {}
        for key, value in getattr(model, group).items():
            std = {"s0": STATED_TRIM}.get(key, STATED_ERROR * abs(value))
            std = STATED_DELAY * size.time if group == "delay" else std
            entries[key] = Quantity(value, std) if value else value
        groups[group] = entries
    return msgspec.structs.replace(model, **groups)


def diagnose_sizes(folder, hidden, seconds):
    """The diagnosis of one drive and another, by size."""
    car = PAPER
    for name, k in hidden.items():
        car = apply(car, name, k=k)
    drives = [simulate(car, 5, seconds), simulate(car, 6, seconds * 2.0 / 3.0)]
    found = {}
    for i, (name, size) in enumerate(CAR_SIZES.items()):
        p = size.scale(PAPER)
        train, test = (log(drive, size, folder / f"{i}_{k}.mcap", k)
                       for k, drive in enumerate(drives))
        inputs = check_inputs([train], [test], p)
        found[name] = diagnose(state_errors(model_of(p), size), p, inputs.train, inputs.test)
    return found


def check_sizes(found, hidden, units):
    """Compare names and relative sizes with what is hidden and with those of 1:10.

    units: unit by which the size of each effect scales.
    """
    relative = {}
    for name, d in found.items():
        assert {c.effect for c in d.causes} == set(hidden), name
        size = CAR_SIZES[name]
        for cause in d.causes:
            factor = {"N": size.force, "rad": 1.0}[units[cause.effect]]
            k = cause.parameters["k"]
            relative[name, cause.effect] = k.value / factor, k.std / factor
            assert k.value / factor == pytest.approx(hidden[cause.effect], rel=MAX_ERROR), name
    for (name, effect), (value, std) in relative.items():
        of_1_10, its_std = relative["1:10", effect]
        assert abs(value - of_1_10) < (std**2 + its_std**2)**0.5, (name, effect)
        assert 0.4 < std / its_std < 2.5, (name, effect)


@pytest.mark.slow
def test_a_hidden_force_is_found_at_all_sizes(tmp_path):
    hidden = {"rolling_resistance": 0.5}
    check_sizes(diagnose_sizes(tmp_path, hidden, 30.0), hidden, {"rolling_resistance": "N"})


@pytest.mark.long
def test_two_hidden_causes_are_found_at_all_sizes(tmp_path):
    hidden = {"rolling_resistance": 0.8, "steering_backlash": 0.08}
    check_sizes(diagnose_sizes(tmp_path, hidden, 45.0), hidden,
                {"rolling_resistance": "N", "steering_backlash": "rad"})


@pytest.mark.slow
def test_where_nothing_is_hidden_nothing_is_named(tmp_path):
    """Control."""
    for name, d in diagnose_sizes(tmp_path, {}, 60.0).items():
        assert d.verdict == "nothing_wrong", name


@pytest.mark.long
def test_a_joint_fit_is_the_same_at_all_sizes(tmp_path):
    """From the set of the paper with the sizes of the car, whose forces scale with them."""
    drive = simulate(PAPER, 5, 30.0)
    for name, size in CAR_SIZES.items():
        recording = log(drive, size, tmp_path / "run.mcap")
        base = set_sizes(find_model("paper")[0], recording.car.geometry)
        fits = identify([recording], base, joint=True).fits
        p = size.scale(PAPER)
        for group, keys in {"friction": "a", "motor": "d e g",
                            "tyres": "front_D rear_cornering_stiffness"}.items():
            assert fits[group].converged, (name, group)
            for key in keys.split():
                found = fits[group].parameters[key]
                true = getattr(getattr(p, group), key)
                assert abs(found.value - true) < MAX_DEVIATION * found.std, (name, key)
                assert found.std < 0.35 * abs(true), (name, key)
