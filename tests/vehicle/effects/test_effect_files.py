"""Effects in a model.toml: there and back, and refused with the nearest name."""

from __future__ import annotations

import msgspec
import pytest

from dart_hal.core.config import EffectEntry, Quantity, dump, parse_model
from dart_hal.core.errors import ConfigError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import activate, add_effects, apply, catalogue, parse_effects
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model, vehicle_of
from tests.vehicle.effects.effect_drive import medium

EFFECTS_TOML = """
[[effects]]
name = "gyro_latency"
parameters = { k = 0.03 }
[[effects]]
name = "quadratic_drag"
parameters = { k = { value = 0.1, std = 0.02 } }
"""


def test_every_effect_survives_the_file():
    p = add_effects(PAPER, (activate(e, medium(e)) for e in catalogue().values()))
    assert vehicle_of(parse_model(dump(model_of(p)), "model.toml")) == p


def test_a_file_with_effects_is_a_vehicle_with_effects(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(dump(model_of(PAPER)) + EFFECTS_TOML, encoding="utf-8")
    model, p = find_model(path)
    assert p == add_effects(PAPER, parse_effects("quadratic_drag:0.1,gyro_latency:0.03"))
    assert model.effects[1].parameters["k"] == Quantity(0.1, 0.02)


def test_standard_errors_stay_with_the_numbers_they_belong_to():
    old = msgspec.structs.replace(
        model_of(PAPER), friction={"a": Quantity(PAPER.friction.a, 0.02), "b": Quantity(9.0, 1.0)},
        effects=(EffectEntry("quadratic_drag", {"k": Quantity(0.1, 0.02)}),
                 EffectEntry("grip", {"k": Quantity(0.1, 0.03)})))
    p = apply(add_effects(PAPER, parse_effects("quadratic_drag:0.1,grip:0.2")), "mass", k=0.1)
    new = model_of(p, old)
    assert new.friction["a"] == Quantity(PAPER.friction.a, 0.02)
    assert new.friction["b"] == PAPER.friction.b, "another number: its error is not known"
    assert {e.name: e.parameters["k"] for e in new.effects} == {
        "quadratic_drag": Quantity(0.1, 0.02), "grip": 0.2, "mass": 0.1}
    assert vehicle_of(new) == p
    assert model_of(vehicle_of(old), old).effects == tuple(
        sorted(old.effects, key=lambda e: e.name))


@pytest.mark.parametrize(("entry", "message", "helps"), [
    (EffectEntry("quadratic_drga", {"k": 0.1}), "quadratic_drga", "quadratic_drag"),
    (EffectEntry("quadratic_drag", {"q": 0.1}), "no parameter 'q'", "k"),
    (EffectEntry("quadratic_drag", {"k": -0.1}), "out of range", "unit")])
def test_what_is_not_in_the_catalogue_is_refused(entry, message, helps):
    with pytest.raises(ConfigError, match=message) as caught:
        vehicle_of(msgspec.structs.replace(model_of(PAPER), effects=(entry,)))
    assert helps in caught.value.remedy


def test_an_effect_is_named_once():
    twice = (EffectEntry("grip", {"k": 0.1}),) * 2
    with pytest.raises(ConfigError, match="twice"):
        vehicle_of(msgspec.structs.replace(model_of(PAPER), effects=twice))


def test_a_parameter_left_out_is_at_its_null_value():
    p = vehicle_of(msgspec.structs.replace(
        model_of(PAPER), effects=(EffectEntry("encoder_ring", {"missing": 0.05}),)))
    assert p.effects[0].values == (0.05, 0.0, 0.0)
