"""A vehicle as a row of named numbers, and back: "friction.a", "quadratic_drag.k", ...

What a fit varies, a covariance is about and a compiled kernel takes. ``stack``
makes one vehicle whose parameters are arrays, a value for each car of a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle, scaled_bounds
from dart_hal.vehicle.scale import Scale, find_scale

Group = TypeVar("Group")
LENGTHS = ("wheelbase", "l_f", "l_r")
# Of the wheelbase, between the centre of mass and an axle: no car has its mass on one axle.
MIN_AXLE_SHARE = 0.02
PARAMETER_GROUPS = ("body", "friction", "motor", "steering", "delay", "tyres")


def names(p: Vehicle) -> tuple[str, ...]:
    """Names of all parameters, "group.key" and "effect.key", in a fixed order."""
    return tuple(values(p))


def values(p: Vehicle) -> dict[str, Any]:
    """All parameters by name, in the order of ``names``."""
    parts = ((group, getattr(p, group)) for group in PARAMETER_GROUPS)
    out = {f"{group}.{key}": getattr(part, key) for group, part in parts
           for key in _parameters(part)}
    for applied in p.effects:
        for parameter, number in zip(applied.effect.parameters, applied.values, strict=True):
            out[f"{applied.name}.{parameter.name}"] = number
    return out


def shapes(p: Vehicle) -> set[tuple[int, ...]]:
    """Of the arrays among the parameters; none of a single vehicle."""
    return {v.shape for v in values(p).values() if isinstance(v, np.ndarray) and v.shape}


def value(p: Vehicle, name: str) -> Any:
    """The parameter of that name. Raises UsageError for an unknown one."""
    group, key, applied = _find_parameter(p, name)
    if applied is None:
        return getattr(getattr(p, group), key)
    return applied.values[_index(applied, key)]


def unit(p: Vehicle, name: str) -> str:
    """Unit of the parameter of that name."""
    group, key, applied = _find_parameter(p, name)
    if applied is None:
        return str(_metadata(p, group, key)["unit"])
    return applied.effect.parameters[_index(applied, key)].unit


def bounds(p: Vehicle, name: str) -> tuple[float, float]:
    """Interval in which the parameter must lie."""
    group, key, applied = _find_parameter(p, name)
    if applied is None:
        meta = _metadata(p, group, key)
        return scaled_bounds(meta, p.body.mass)
    parameter = applied.effect.parameters[_index(applied, key)].at_scale(find_scale(p.body))
    return parameter.low, parameter.high


def with_values(p: Vehicle, changed: Mapping[str, float]) -> Vehicle:
    """The same vehicle with some parameters changed and checked.

    Raises ConfigError when one is out of its bounds, UsageError for an
    unknown name.
    """
    changes: dict[str, dict[str, float]] = {}
    effects = {applied.name: applied for applied in p.effects}
    for name, number in changed.items():
        group, key, applied = _find_parameter(p, name)
        if applied is None:
            changes.setdefault(group, {})[key] = float(number)
        else:
            effects[group] = change_values(effects[group], {key: float(number)},
                                           find_scale(p.body))
    groups: dict[str, Any] = {group: replace(getattr(p, group), **part)
                              for group, part in changes.items()}
    return replace(p, effects=tuple(effects.values()), **groups)


def change_values(applied: ActiveEffect, changed: Mapping[str, float], scale: Scale
                  ) -> ActiveEffect:
    """An effect with some values changed. Raises ConfigError out of bounds."""
    numbers = list(applied.values)
    for key, number in changed.items():
        i = _index(applied, key)
        parameter = applied.effect.parameters[i].at_scale(scale)
        if not parameter.low <= number <= parameter.high:
            raise ConfigError(
                f"{applied.name}.{key} = {number!r} is out of range",
                found=f"{number!r} {parameter.unit}",
                expected=f"{parameter.low} to {parameter.high} {parameter.unit}",
                remedy="check the unit; files hold SI units and radians")
        numbers[i] = number
    return ActiveEffect(applied.effect, tuple(numbers))


def make_setter(p: Vehicle, names: Sequence[str]) -> Callable[[Sequence[float]], Vehicle]:
    """``with_values`` of the same parameters again and again, unchecked.

    The numbers must be within ``bounds``. Of the lengths of the body at most two are given, as
    ``close_lengths`` takes them. Raises UsageError for an unknown name.
    """
    # Place of each number: a field of a group of parameters, or a value of an effect.
    groups: dict[str, list[tuple[str, int]]] = {}
    inside: dict[str, list[tuple[int, int]]] = {}
    for i, name in enumerate(names):
        group, key, applied = _find_parameter(p, name)
        if applied is None:
            groups.setdefault(group, []).append((key, i))
        else:
            inside.setdefault(group, []).append((_index(applied, key), i))
    def change(applied: ActiveEffect, numbers: Sequence[float]) -> ActiveEffect:
        own = list(applied.values)
        for at, i in inside.get(applied.name, ()):
            own[at] = numbers[i]
        return ActiveEffect(applied.effect, tuple(own))

    def vehicle(numbers: Sequence[float]) -> Vehicle:
        changes = {group: _replace_fields(getattr(p, group), {key: numbers[i] for key, i in part})
                   for group, part in groups.items() if group != "body"}
        if "body" in groups:
            sizes = {key: numbers[i] for key, i in groups["body"]}
            lengths = close_lengths({key: getattr(p.body, key) for key in LENGTHS}, sizes)
            changes["body"] = _replace_fields(p.body, {**sizes, **lengths})
        effects = tuple(change(a, numbers) for a in p.effects) if inside else p.effects
        return _replace_fields(p, {**changes, "effects": effects})

    return vehicle


def close_lengths(body: Mapping[str, float], changed: Mapping[str, float]) -> dict[str, float]:
    """Wheelbase, l_f and l_r after a change of one or two of them; {} without one.

    body: all three before. The wheelbase stays l_f + l_r: two changed lengths give the third one.
    A changed l_f or l_r keeps the wheelbase, a changed wheelbase the share of the axle loads. The
    centre of mass stays between the axles.
    """
    if not set(changed) & set(LENGTHS):
        return {}
    wheelbase = changed.get("wheelbase", body["wheelbase"])
    # A changed wheelbase alone keeps the ratio l_f / wheelbase; a changed l_r gives l_f.
    l_f = changed.get("l_f", wheelbase * body["l_f"] / body["wheelbase"])
    if "l_r" in changed:
        l_f = wheelbase - changed["l_r"]
    nearest = MIN_AXLE_SHARE * wheelbase
    l_f = min(max(l_f, nearest), wheelbase - nearest)
    return {"wheelbase": wheelbase, "l_f": l_f, "l_r": wheelbase - l_f}


def bind(p: Vehicle, lookup: Callable[[str], Value]) -> Vehicle:
    """Return a copy whose parameters are ``lookup(name)``, unchecked: arrays or symbols."""
    changed = {group: {key: lookup(f"{group}.{key}") for key in _parameters(getattr(p, group))}
               for group in PARAMETER_GROUPS}
    effects = tuple(ActiveEffect(a.effect, tuple(lookup(f"{a.name}.{parameter.name}")
                                            for parameter in a.effect.parameters))
                    for a in p.effects)
    return replace(replace_unchecked(p, changed), effects=effects)


def replace_unchecked(p: Vehicle, changes: Mapping[str, Mapping[str, Value]]) -> Vehicle:
    """A clone with changed parameters, {group: {key: value}}, that may be arrays or symbols."""
    return _replace_fields(p, {group: _replace_fields(getattr(p, group), part)
                               for group, part in changes.items()})


def stack(vehicles: Sequence[Vehicle], dtype: DTypeLike = np.float64) -> Vehicle:
    """Return one vehicle whose parameters are arrays (n,), one element for each of n vehicles.

    Parameters that are equal in all of them stay floats. Raises UsageError for an empty
    sequence or vehicles of different equations.
    """
    if not vehicles:
        raise UsageError("no vehicle to stack", expected="at least one")
    first = vehicles[0]
    for v in vehicles[1:]:
        if form(v) != form(first):
            raise UsageError("vehicles of different equations do not run in one batch",
                             found=f"{form(v)} and {form(first)}",
                             expected="the same kind, slip angles, motor and tyre form")

    def stacked_value(name: str) -> Value:
        numbers = [value(v, name) for v in vehicles]
        return numbers[0] if len(set(numbers)) == 1 else np.array(numbers, dtype=dtype)

    return bind(first, stacked_value)


def form(p: Vehicle) -> str:
    """Describe the equations of a vehicle: "dynamic, PaperTyres, all_speeds, grip"."""
    loop = () if p.drive == "duty" else (type(p.motor).__name__,)
    return ", ".join((p.kind, type(p.tyres).__name__, p.slip, *loop,
                      *(a.name for a in p.effects)))


def _find_parameter(p: Vehicle, name: str) -> tuple[str, str, ActiveEffect | None]:
    group, _, key = name.partition(".")
    if group in PARAMETER_GROUPS and key in _parameters(getattr(p, group)):
        return group, key, None
    for applied in p.effects:
        if applied.name == group and any(q.name == key for q in applied.effect.parameters):
            return group, key, applied
    raise UsageError(f"no parameter is called {name!r}", expected=", ".join(names(p)))


def _replace_fields(old: Group, changed: Mapping[str, Any]) -> Group:
    """Replace fields without the checks of a dataclass, which cost as much as a short rollout."""
    new = object.__new__(type(old))
    for key in _fields(old):
        object.__setattr__(new, key, changed[key] if key in changed else getattr(old, key))
    return new


def _parameters(group: Any) -> tuple[str, ...]:
    return _field_names(group.__class__)[0]


def _fields(group: Any) -> tuple[str, ...]:
    return _field_names(group.__class__)[1]


@cache
def _field_names(group: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (fields that are parameters, all fields); cached, a fit needs them often."""
    every = fields(group)
    return (tuple(f.name for f in every if "unit" in f.metadata), tuple(f.name for f in every))


def _index(applied: ActiveEffect, key: str) -> int:
    return [parameter.name for parameter in applied.effect.parameters].index(key)


def _metadata(p: Vehicle, group: str, key: str) -> Any:
    return next(f.metadata for f in fields(getattr(p, group)) if f.name == key)
