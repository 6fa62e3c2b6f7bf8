"""A vehicle as a row of named numbers, and back: "friction.a", "tyres.front_D", ...

What a fit varies, a covariance is about and a compiled kernel takes. ``stack``
makes one vehicle whose parameters are arrays, a value for each car of a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from dart_hal.errors import UsageError
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle

GROUPS = ("body", "friction", "motor", "steering", "delay", "tyres")


def names(p: Vehicle) -> tuple[str, ...]:
    """Names of all parameters, "group.key", in a fixed order."""
    return tuple(f"{group}.{f.name}" for group in GROUPS for f in fields(getattr(p, group))
                 if "unit" in f.metadata)


def value(p: Vehicle, name: str) -> Any:
    """The parameter of that name. Raises UsageError for an unknown one."""
    group, _, key = name.partition(".")
    if name not in names(p):
        raise UsageError(f"no parameter is called {name!r}", expected=", ".join(names(p)))
    return getattr(getattr(p, group), key)


def unit(p: Vehicle, name: str) -> str:
    """Unit of the parameter of that name."""
    return str(_metadata(p, name)["unit"])


def bounds(p: Vehicle, name: str) -> tuple[float, float]:
    """Interval in which the parameter must lie."""
    meta = _metadata(p, name)
    return float(meta["low"]), float(meta["high"])


def with_values(p: Vehicle, values: Mapping[str, float]) -> Vehicle:
    """The same vehicle with some parameters changed and checked.

    Raises ConfigError when one is out of its bounds, UsageError for an
    unknown name.
    """
    changes: dict[str, dict[str, float]] = {}
    for name, number in values.items():
        value(p, name)
        group, _, key = name.partition(".")
        changes.setdefault(group, {})[key] = float(number)
    groups: dict[str, Any] = {group: replace(getattr(p, group), **part)
                              for group, part in changes.items()}
    return replace(p, **groups)


def bind(p: Vehicle, of: Callable[[str], Value]) -> Vehicle:
    """A clone whose parameters are ``of(name)``, unchecked: arrays or symbols."""
    out = replace(p)
    for group in GROUPS:
        old = getattr(p, group)
        new = object.__new__(type(old))
        for f in fields(old):
            object.__setattr__(new, f.name,
                               of(f"{group}.{f.name}") if "unit" in f.metadata
                               else getattr(old, f.name))
        object.__setattr__(out, group, new)
    return out


def stack(vehicles: Sequence[Vehicle], dtype: DTypeLike = np.float64) -> Vehicle:
    """One vehicle with arrays (n,) for parameters, a lane for each of n vehicles.

    What is equal in all of them stays a float. Raises UsageError for an empty
    sequence or vehicles of different equations.
    """
    if not vehicles:
        raise UsageError("no vehicle to stack", expected="at least one")
    first = vehicles[0]
    for v in vehicles[1:]:
        if (v.kind, v.slip, type(v.tyres)) != (first.kind, first.slip, type(first.tyres)):
            raise UsageError("vehicles of different equations do not run in one batch",
                             found=f"{form(v)} beside {form(first)}",
                             expected="the same kind, slip angles and tyre form")

    def of(name: str) -> Value:
        group, _, key = name.partition(".")
        numbers = [getattr(getattr(v, group), key) for v in vehicles]
        return numbers[0] if len(set(numbers)) == 1 else np.array(numbers, dtype=dtype)

    return bind(first, of)


def form(p: Vehicle) -> str:
    """Which equations a vehicle has, in words: "dynamic, PaperTyres, all_speeds"."""
    return f"{p.kind}, {type(p.tyres).__name__}, {p.slip}"


def _metadata(p: Vehicle, name: str) -> Any:
    value(p, name)
    group, _, key = name.partition(".")
    return next(f.metadata for f in fields(getattr(p, group)) if f.name == key)
