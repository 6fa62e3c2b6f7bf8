"""``dart-hal sim`` with effects and with a model file: what it reveals, what it refuses."""

from __future__ import annotations

import pytest

from dart_hal.core.config import save_model
from dart_hal.vehicle import UPSTREAM_2024
from dart_hal.vehicle.effects import add_effects, parse_effects
from dart_hal.vehicle.file import model_of

EFFECT_TEXT = "steering_lag:0.06,encoder_ring:missing=0.1"


def test_reveal_lists_the_effects(verb):
    shown = verb("sim", "--reveal", "--url", f"sim://?seed=2&effect={EFFECT_TEXT}", "--json").json
    assert shown["effects"] == [
        {"name": "steering_lag", "parameters": {"k": {"value": 0.06, "unit": "s"}}},
        {"name": "encoder_ring", "parameters": {
            "missing": {"value": 0.1, "unit": "turn"}, "uneven": {"value": 0.0, "unit": "relative"},
            "phase": {"value": 0.0, "unit": "turn"}}}]
    output = verb("sim", "--reveal", "--url", f"sim://?effect={EFFECT_TEXT}")
    assert "steering_lag.k" in output.out
    assert verb("sim", "--reveal", "--url", "sim://?seed=2", "--json").json["effects"] == []


def test_a_model_file_is_the_car(verb, tmp_path):
    path = tmp_path / "of me & you.toml"                # what a URL has to quote
    save_model(model_of(add_effects(UPSTREAM_2024, parse_effects(EFFECT_TEXT))), path)
    shown = verb("sim", "--reveal", "--vehicle", path, "--json").json
    assert [e["name"] for e in shown["effects"]] == ["steering_lag", "encoder_ring"]
    assert shown["vehicle"]["name"] == UPSTREAM_2024.name
    both = verb("sim", "--reveal", "--vehicle", path, "--url", "sim://?seed=3&effect=mass:0.1",
                "--json").json
    assert (both["seed"], both["effects"][0]["name"]) == (3, "steering_lag")
    assert "mass" in [e["name"] for e in both["effects"]]


def test_every_number_of_a_set_without_bounds_is_json(verb):
    shown = verb("sim", "--reveal", "--vehicle", "paper", "--json").json
    assert shown["vehicle"]["tyres"]["rear_max"]["value"] is None      # it has no end


@pytest.mark.parametrize(("arguments", "words"), [
    (["--url", "sim://?effect=mocap_yaw:0.01"], "motion capture"),
    (["--url", "sim://?effect=steering_lack:0.06"], "steering_lag"),
    (["--url", "sim://?effect=steering_lag:6"], "out of range"),
    (["--vehicle", "nothing.toml"], "no model is called"),
    (["--vehicle", "paper", "--url", "sim://?vehicle=paper"], "given twice"),
    (["--url", "sim://?seed=-1"], "is no seed")])
def test_nonsense_is_refused_in_words(verb, arguments, words):
    done = verb("sim", "--reveal", "--json", *arguments)
    assert done.code == 2
    assert words in str(done.json["error"])
