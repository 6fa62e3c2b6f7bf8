"""A ``model.toml`` as a vehicle, and back."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields, replace
from typing import Any

from dart_hal.core.config import EffectEntry, ModelFile, plain
from dart_hal.core.config.model import Parameter, Parameters
from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import activate, add_effects, find_effect
from dart_hal.vehicle.flat import PARAMETER_GROUPS as SECTIONS
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.parameters import (
    MOTOR_FORMS,
    AxleTyres,
    Body,
    Delay,
    Friction,
    PaperTyres,
    Steering,
    Vehicle,
)
from dart_hal.vehicle.scale import Scale, find_scale

PARAMETER_CLASSES: dict[str, Any] = {"body": Body, "friction": Friction,
                          "steering": Steering, "delay": Delay}


def vehicle_from(model: ModelFile, base: Vehicle | None = None) -> Vehicle:
    """The vehicle of a model file; what it leaves out is the base's, but its effects are its own.

    Raises ConfigError on a value out of its bounds, or missing without a base,
    and on an effect that is unknown or named twice.
    """
    groups = {name: _read_group(kind, name, model, getattr(base, name, None))
              for name, kind in PARAMETER_CLASSES.items()}
    groups["motor"] = _read_motor(model, base)
    others = sorted(set(model.forms) - {"slip", "motor"})
    if others:
        raise ConfigError(f"{model.name}: forms has what no equation knows: {', '.join(others)}",
                          found=", ".join(model.forms), expected="slip, motor",
                          remedy="leave it out; tyres are by axle when they have rear_D")
    kind = AxleTyres if "rear_D" in model.tyres else PaperTyres
    old = getattr(base, "tyres", None)
    tyres = _read_group(kind, "tyres", model, old if isinstance(old, kind) else None)
    slip = model.forms.get("slip", base.slip if base is not None else "all_speeds")
    p = Vehicle(name=model.name, tyres=tyres, kind=model.kind, slip=slip,
                motor_voltage=model.motor_voltage, **groups)
    return add_effects(p, _read_effects(model, find_scale(p.body)))


def model_of(p: Vehicle, old: ModelFile | None = None) -> ModelFile:
    """The model file of a vehicle; ``vehicle_from`` gives the same vehicle back.

    Numbers that ``old`` has as well keep the standard error that it has for them.
    """
    known = _list_entries(old) if old is not None else {}
    sections: dict[str, Parameters] = {}
    for name in names(p):
        number = value(p, name)
        if math.isfinite(number):
            section, _, key = name.partition(".")
            entry = known.get(name, number)
            sections.setdefault(section, {})[key] = entry if plain(entry) == number else number
    effects = tuple(EffectEntry(a.name, sections.pop(a.name)) for a in p.effects)
    forms = {"slip": p.slip} if p.drive == "duty" else {"slip": p.slip, "motor": p.drive}
    return ModelFile(name=p.name, kind="kinematic" if p.kind == "kinematic" else "dynamic",
                     forms=forms, motor_voltage=p.motor_voltage, effects=effects,
                     **sections)  # type: ignore[arg-type]


def missing_parameters(model: ModelFile, p: Vehicle) -> tuple[str, ...]:
    """List parameters of vehicle ``p`` that the file lacks: "group.key", "group" for all of it.

    Tyres of a kinematic model and parameters with a default are not listed.
    """
    out: list[str] = []
    for group in SECTIONS:
        if group == "tyres" and p.kind == "kinematic":
            continue
        needed = [f.name for f in fields(getattr(p, group))
                  if "unit" in f.metadata and f.default is MISSING]
        missing = [key for key in needed if key not in getattr(model, group)]
        out += [group] if missing == needed and needed else [f"{group}.{k}" for k in missing]
    return tuple(out)


def _list_entries(model: ModelFile) -> dict[str, Parameter]:
    """Every number of a file as it is written there, by "group.key" and "effect.key"."""
    tables = [(name, getattr(model, name)) for name in SECTIONS]
    tables += [(e.name, e.parameters) for e in model.effects]
    return {f"{name}.{key}": entry for name, table in tables for key, entry in table.items()}


def _read_motor(model: ModelFile, base: Vehicle | None) -> Any:
    """The motor of the form that the file names, else of the base's form, else of duty."""
    form = model.forms.get("motor", base.drive if base is not None else "duty")
    if form not in MOTOR_FORMS:
        raise ConfigError(f"{model.name}: forms.motor = {form!r} is not known", found=repr(form),
                          expected=" or ".join(MOTOR_FORMS),
                          remedy="check the spelling in model.toml")
    same = base is not None and base.drive == form
    return _read_group(MOTOR_FORMS[form], "motor", model, base.motor if same and base else None)


def _read_effects(model: ModelFile, scale: Scale) -> list[ActiveEffect]:
    found: dict[str, ActiveEffect] = {}
    for entry in model.effects:
        if entry.name in found:
            raise ConfigError(f"{model.name}: the effect {entry.name} is named twice",
                              found=entry.name, expected="each effect once",
                              remedy="put both into one entry of [[effects]]")
        try:
            found[entry.name] = activate(find_effect(entry.name),
                                        {key: plain(v) for key, v in entry.parameters.items()},
                                        scale)
        except UsageError as why:
            raise ConfigError(f"{model.name}: {why.what}", found=why.found or entry.name,
                              expected=why.expected, remedy=why.remedy) from why
    return list(found.values())


def _read_group(kind: Any, section: str, model: ModelFile, old: Any) -> Any:
    given = model.values(section)
    known = {f.name: f for f in fields(kind)}
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise ConfigError(f"{model.name}: {section} has what its form does not know: "
                          f"{', '.join(unknown)}", found=", ".join(given),
                          expected=", ".join(known),
                          remedy="tyres are of one form: the paper's or, with rear_D, by axle; "
                                 'a motor has gain and max_force with forms.motor = "speed"')
    if old is not None:
        return replace(old, **given)
    missing = [n for n, f in known.items() if n not in given and f.default is MISSING]
    if missing:
        raise ConfigError(f"{model.name}: {section} lacks {', '.join(missing)}",
                          found=", ".join(given) or "nothing", expected=", ".join(known),
                          remedy="dart-hal identify all FILES writes complete models")
    return kind(**given)
