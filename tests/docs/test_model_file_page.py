"""Every key of model.toml is in its reference page, with unit, bounds and meaning."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import msgspec

from dart_hal.core.config import ModelFile
from dart_hal.core.config.model import MODEL_KEYS, MODEL_PARAMETERS
from dart_hal.vehicle.file import PARAMETER_CLASSES
from dart_hal.vehicle.parameters import AxleTyres, Motor, PaperTyres, SpeedLoop
from dart_lab.pages.model_page import render_model_file

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "model_file.md"


def test_page_is_that_of_the_program():
    assert PAGE.read_text(encoding="utf-8") == render_model_file(), "dart-hal wire --write"


def test_every_key_of_the_file_is_described():
    assert list(MODEL_KEYS) == [f.name for f in msgspec.structs.fields(ModelFile)]


def test_every_parameter_has_a_row_with_unit_and_meaning():
    lines = render_model_file().splitlines()
    kinds = [*PARAMETER_CLASSES.items(), ("tyres", PaperTyres), ("tyres", AxleTyres),
             ("motor", Motor), ("motor", SpeedLoop)]
    described: dict[str, set[str]] = {}
    for section, kind in kinds:
        for f in fields(kind):
            described.setdefault(section, set()).add(f.name)
            assert f.metadata["meaning"]
            assert any(line.startswith(f"| `{f.name}` | {f.metadata['meaning']} | "
                                       f"{f.metadata['unit']} |") for line in lines)
    assert described == {section: set(keys) for section, keys in MODEL_PARAMETERS.items()}


def test_bounds_of_forces_are_marked():
    text = render_model_file()
    assert "| `d` | force per throttle at rest | N | 0 | 200 *m* | - |" in text
    assert "largest side force of the rear axle | N | 0.1 *m* | none | none |" in text
