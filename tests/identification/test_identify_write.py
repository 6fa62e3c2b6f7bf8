"""What reaches a model.toml: sound fits with their errors; never an unsound one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.config import Quantity, load_model
from dart_hal.core.config.model import Covariance
from dart_hal.vehicle import PAPER, UPSTREAM_2024
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.flat import with_values
from dart_hal.vehicle.load import vehicle_of
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.write import Source, build_model, why_unsound, write

SOURCE = Source({"a.csv": "12ab"}, "dart-hal identify all a.csv", {"a.csv": (0.09, -0.0164, 0.0)})


def fit(name, values, **changes):
    k = len(values)
    spread = np.diag(np.linspace(0.01, 0.02, k)) + 0.001
    given = SubmodelFit(name, {key: FittedParameter(value, math.sqrt(spread[i, i]), "N")
                               for i, (key, value) in enumerate(values.items())},
                        spread, 500, 0.2, "N", True)
    return replace(given, **changes)


FRICTION = {"a": 1.5, "b": 11.0, "c": 0.4}
MOTOR = {"d": 20.0, "e": 3.0, "g": -0.12}
TYRES = {"front_D": 4.0, "front_C": 1.2, "front_B": 9.0, "front_E": -0.5,
         "rear_cornering_stiffness": 40.0}


def test_a_sound_fit_comes_back_from_the_file(tmp_path):
    fits = {"friction": fit("friction", FRICTION), "motor": fit("motor", MOTOR)}
    path = write(build_model(fits, model_of(PAPER), SOURCE), tmp_path / "model.toml")
    model = load_model(path)
    assert model.friction["a"] == Quantity(1.5, math.sqrt(0.011))
    car = vehicle_of(model)
    assert (car.friction.a, car.friction.b, car.friction.c) == (1.5, 11.0, 0.4)
    assert car.motor.g == -0.12
    assert car.motor.reverse == PAPER.motor.reverse
    assert (car.steering, car.tyres, car.body) == (PAPER.steering, PAPER.tyres, PAPER.body)
    table = model.covariance["friction"]
    assert table.names == ("friction.a", "friction.b", "friction.c")
    assert np.array(table.matrix) == pytest.approx(fits["friction"].covariance)
    assert model.provenance["files"] == {"a.csv": "12ab"}
    assert model.provenance["reference"]["a.csv"] == [0.09, -0.0164, 0.0]
    assert set(model.provenance["sections"]) == {"friction", "motor"}
    assert model.provenance["dart_hal"]


@pytest.mark.parametrize(("changes", "text"), [
    ({"converged": False}, "did not converge"), ({"at_bound": ("b",)}, "b stopped at the edge"),
    ({"converged": False, "n": 0}, "not identified")])
def test_an_unsound_fit_leaves_a_good_file_as_it_is(tmp_path, changes, text):
    path = tmp_path / "model.toml"
    write(build_model({"friction": fit("friction", FRICTION)}, model_of(PAPER), SOURCE), path)
    before = path.read_bytes()
    bad = fit("friction", {**FRICTION, "a": 9.9}, **changes)
    assert text in why_unsound(bad)
    written = build_model({"friction": bad}, load_model(path), SOURCE)
    assert written.model is None
    assert text in written.left_out["friction"]
    assert write(written, path) is None
    assert path.read_bytes() == before
    assert not (tmp_path / "history").exists()


def test_an_unsound_section_keeps_the_identified_values_of_before(tmp_path):
    path = tmp_path / "model.toml"
    first = {"friction": fit("friction", FRICTION), "motor": fit("motor", MOTOR)}
    write(build_model(first, model_of(PAPER), SOURCE), path)
    second = {"friction": fit("friction", {**FRICTION, "a": 1.9}),
              "motor": fit("motor", {**MOTOR, "d": 99.0}, at_bound=("d",))}
    again = build_model(second, load_model(path), Source({"b.csv": "34cd"}, "again"))
    write(again, path)
    model = load_model(path)
    assert model.motor["d"] == Quantity(20.0, math.sqrt(0.011))
    assert model.friction["a"].value == 1.9
    assert np.array(model.covariance["motor"].matrix) == pytest.approx(first["motor"].covariance)
    assert model.provenance["sections"]["motor"]["command"] == SOURCE.command
    assert model.provenance["sections"]["friction"]["command"] == "again"
    assert set(model.provenance["files"]) == {"a.csv", "b.csv"}
    assert len(list((tmp_path / "history").iterdir())) == 1


def test_a_joint_covariance_takes_the_place_of_the_single_ones(tmp_path):
    fits = {name: fit(name, values) for name, values in (("friction", FRICTION), ("motor", MOTOR))}
    joint = Covariance(("friction.a", "motor.d"), ((0.01, 0.002), (0.002, 0.04)))
    path = write(build_model(fits, model_of(PAPER), SOURCE, joint=joint), tmp_path / "model.toml")
    assert load_model(path).covariance == {"joint": joint}
    # a later fit of one section alone: the joint table no longer holds
    model = build_model({"motor": fits["motor"]}, load_model(path), SOURCE).model
    assert set(model.covariance) == {"motor"}


def test_a_joint_fit_is_written_whole_or_not_at_all():
    """Friction that was fitted with one motor means nothing with another motor."""
    fits = {name: fit(name, values) for name, values in (("friction", FRICTION), ("motor", MOTOR))}
    joint = Covariance(("friction.a", "motor.d"), ((0.01, 0.002), (0.002, 0.04)))
    bad = {**fits, "motor": replace(fits["motor"], at_bound=("e",))}
    written = build_model(bad, model_of(PAPER), SOURCE, joint=joint)
    assert written.model is None
    assert set(written.left_out) == {"friction", "motor"}
    assert "motor: e stopped" in written.left_out["friction"]


def test_tyres_of_the_same_form_keep_what_was_not_fitted():
    base = model_of(with_values(PAPER, {"tyres.front_E": -2.0}))
    written = build_model({"tyres": fit("tyres", {"front_D": 4.0})}, base, SOURCE)
    car = vehicle_of(written.model)
    assert (car.tyres.front_D, car.tyres.front_E) == (4.0, -2.0)
    axle = build_model({"tyres": fit("tyres", {"front_D": 0.9, "rear_D": 0.8})},
                       model_of(UPSTREAM_2024), SOURCE)
    assert vehicle_of(axle.model).slip == UPSTREAM_2024.slip
    assert vehicle_of(axle.model).tyres.rear_C == UPSTREAM_2024.tyres.rear_C


def test_values_that_no_car_can_have_are_left_out():
    written = build_model({"friction": fit("friction", {**FRICTION, "a": -3.0}),
                           "motor": fit("motor", MOTOR)}, model_of(PAPER), SOURCE)
    assert written.sections == ("motor",)
    assert "out of range" in written.left_out["friction"]
    assert vehicle_of(written.model).friction == PAPER.friction


def test_tyres_replace_those_of_another_form():
    written = build_model({"tyres": fit("tyres", TYRES)}, model_of(UPSTREAM_2024), SOURCE)
    car = vehicle_of(written.model)
    assert car.tyres.rear_cornering_stiffness == 40.0
    assert car.tyres.front_D == 4.0
    assert car.friction == UPSTREAM_2024.friction


def test_an_unknown_error_is_not_written_as_a_number(tmp_path):
    estimates = {"a": FittedParameter(1.5, 0.1, "N"),
                 "b": FittedParameter(12.0, math.inf, "s/m", False),
                 "c": FittedParameter(0.4, 0.1, "N s/m")}
    covariance = np.full((3, 3), np.inf)
    given = replace(fit("friction", FRICTION), parameters=estimates, covariance=covariance)
    path = write(build_model({"friction": given}, model_of(PAPER), SOURCE), tmp_path / "m.toml")
    model = load_model(path)
    assert model.friction["b"] == 12.0
    assert "friction" not in model.covariance
    assert "inf" not in path.read_text()
