"""A ``model.toml`` as a vehicle and back; what a file leaves out is the paper's."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from dart_hal.config import ModelFile, load_model
from dart_hal.errors import UsageError
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.parameters import AxleTyres, PaperTyres, Vehicle
from dart_hal.vehicle.sets import PAPER, SETS

GROUPS = ("body", "friction", "motor", "steering", "delay")


def vehicle_of(model: ModelFile | None) -> Vehicle:
    """The vehicle of a model file; None = the paper's. Raises ConfigError on a bad value."""
    if model is None:
        return PAPER
    groups = {name: replace(getattr(PAPER, name), **model.values(name)) for name in GROUPS}
    given = model.values("tyres")
    tyres: PaperTyres | AxleTyres
    if "rear_D" in given:
        tyres = AxleTyres(**given)
    else:
        assert isinstance(PAPER.tyres, PaperTyres)
        tyres = replace(PAPER.tyres, **given)
    return replace(PAPER, name=model.name, tyres=tyres, kind=model.kind,
                   slip=model.forms.get("slip", PAPER.slip), **groups)


def model_of(p: Vehicle) -> ModelFile:
    """The model file of a vehicle; ``vehicle_of`` gives the same vehicle back."""
    sections: dict[str, dict[str, float]] = {}
    for name in names(p):
        number = value(p, name)
        if math.isfinite(number):
            section, _, key = name.partition(".")
            sections.setdefault(section, {})[key] = number
    return ModelFile(name=p.name, kind="kinematic" if p.kind == "kinematic" else "dynamic",
                     forms={"slip": p.slip}, **sections)  # type: ignore[arg-type]


def find_model(name: str | Path) -> tuple[ModelFile, Vehicle]:
    """A shipped set by its name, or a ``model.toml``.

    Raises UsageError for a name that is neither, ConfigError for a bad file.
    """
    if str(name) in SETS:
        p = SETS[str(name)]
        return model_of(p), p
    path = Path(name)
    if not path.is_file():
        raise UsageError(f"no model is called {str(name)!r}",
                         found="no such file, and no shipped set of that name",
                         expected=f"a model.toml, or one of {', '.join(SETS)}",
                         remedy="dart-hal identify all FILES --out model.toml writes one")
    model = load_model(path)
    return model, vehicle_of(model)
