"""A ``model.toml`` as a vehicle, and back."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields, replace
from typing import Any

from dart_hal.config import ModelFile
from dart_hal.errors import ConfigError
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.parameters import (
    AxleTyres,
    Body,
    Delay,
    Friction,
    Motor,
    PaperTyres,
    Steering,
    Vehicle,
)

GROUPS: dict[str, Any] = {"body": Body, "friction": Friction, "motor": Motor,
                          "steering": Steering, "delay": Delay}


def vehicle_from(model: ModelFile, base: Vehicle | None = None) -> Vehicle:
    """The vehicle of a model file; what it leaves out is the base's.

    Raises ConfigError on a value out of its bounds, or missing without a base.
    """
    groups = {name: _group(kind, name, model, getattr(base, name, None))
              for name, kind in GROUPS.items()}
    kind = AxleTyres if "rear_D" in model.tyres else PaperTyres
    old = getattr(base, "tyres", None)
    tyres = _group(kind, "tyres", model, old if isinstance(old, kind) else None)
    slip = model.forms.get("slip", base.slip if base is not None else "all_speeds")
    return Vehicle(name=model.name, tyres=tyres, kind=model.kind, slip=slip, **groups)


def model_of(p: Vehicle) -> ModelFile:
    """The model file of a vehicle; ``vehicle_from`` gives the same vehicle back."""
    sections: dict[str, dict[str, float]] = {}
    for name in names(p):
        number = value(p, name)
        if math.isfinite(number):
            section, _, key = name.partition(".")
            sections.setdefault(section, {})[key] = number
    return ModelFile(name=p.name, kind="kinematic" if p.kind == "kinematic" else "dynamic",
                     forms={"slip": p.slip}, **sections)  # type: ignore[arg-type]


def _group(kind: Any, section: str, model: ModelFile, old: Any) -> Any:
    given = model.values(section)
    known = {f.name: f for f in fields(kind)}
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise ConfigError(f"{model.name}: {section} has what its form does not know: "
                          f"{', '.join(unknown)}", found=", ".join(given),
                          expected=", ".join(known),
                          remedy="tyres are of one form: the paper's or, with rear_D, by axle")
    if old is not None:
        return replace(old, **given)
    missing = [n for n, f in known.items() if n not in given and f.default is MISSING]
    if missing:
        raise ConfigError(f"{model.name}: {section} lacks {', '.join(missing)}",
                          found=", ".join(given) or "nothing", expected=", ".join(known),
                          remedy="dart-hal identify all FILES writes complete models")
    return kind(**given)
