"""Catalogue of physical effects that the base models lack, one file per cause.

A module of this package with an ``EFFECT`` is an entry of the catalogue, and
nothing else has to know of it. Other packages add effects by entry points of the group
``dart_hal.effects`` (examples/plugin).
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from dart_hal.core.errors import ConfigError, PluginFailed, UsageError
from dart_hal.vehicle.effect import (
    EFFECT_STAGES,
    ActiveEffect,
    Effect,
    PureDelay,
    effect_at_scale,
)
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale, find_scale

ENTRY_POINT_GROUP = "dart_hal.effects"  # entry points: effects of other packages


@lru_cache(maxsize=1)
def own_effects() -> Mapping[str, Effect]:
    """The effects of this package by name, in the order of the alphabet."""
    found = [importlib.import_module(f"{__name__}.{module.name}").EFFECT
             for module in pkgutil.iter_modules(__path__)]
    return MappingProxyType({e.name: e for e in sorted(found, key=lambda e: e.name)})


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, Effect]:
    """All effects by name, in the order of the alphabet, those of other packages too.

    Raises ConfigError for an entry point that is no effect, or has a name that is taken.
    """
    found = {**own_effects(), **{name: one for name, (one, _) in _added_effects().items()}}
    return MappingProxyType({name: found[name] for name in sorted(found)})


@lru_cache(maxsize=1)
def _added_effects() -> Mapping[str, tuple[Effect, str]]:
    """Effects of other packages by name, each with its module.

    Raises ConfigError for what is no effect, PluginFailed for a module that cannot be imported.
    """
    from importlib.metadata import entry_points

    found: dict[str, tuple[Effect, str]] = {}
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        try:
            one = entry.load()
        except Exception as error:
            owner = entry.dist.name if entry.dist is not None else "an unknown distribution"
            raise PluginFailed(f"{entry.name} = {entry.value} ({ENTRY_POINT_GROUP}) of {owner} "
                               f"failed: {type(error).__name__}: {error}", found=entry.value,
                               remedy=f"correct {owner}, or uninstall it") from error
        is_effect = isinstance(one, Effect)
        if not is_effect or one.name in found or one.name in own_effects():
            raise ConfigError(
                f"the entry point {entry.name} of {ENTRY_POINT_GROUP} cannot be added to the "
                "catalogue",
                found=f"a second effect named {one.name}" if is_effect else repr(one),
                expected="an Effect with a name of its own",
                remedy=f"correct {entry.value}, or uninstall its package")
        found[one.name] = (one, entry.module)
    return found


def equation_text(item: Effect) -> str:
    """Return the equation of an effect: the docstring of its file without the title."""
    module = (f"{__name__}.{item.name}" if item.name in own_effects()
              else _added_effects()[item.name][1])
    return "\n".join((inspect.getdoc(sys.modules[module]) or "").splitlines()[2:])


def find_effect(name: str) -> Effect:
    """The effect of that name. Raises UsageError that names the nearest ones."""
    known = catalogue()
    if name in known:
        return known[name]
    from difflib import get_close_matches

    near = get_close_matches(name, known, n=3, cutoff=0.4)
    raise UsageError(f"no effect is called {name!r}", expected="one of " + ", ".join(known),
                     remedy=f"write {' or '.join(near)}" if near else "dart-hal diagnose --help")


def is_applicable(item: Effect, p: Vehicle) -> bool:
    """Return whether an effect has a meaning for the motor of a vehicle."""
    return p.drive == "duty" or not item.duty_only


def effect_for(p: Vehicle, name: str) -> Effect:
    """Return an effect of the catalogue with the intervals and sizes of a vehicle's scale."""
    return effect_at_scale(catalogue()[name], find_scale(p.body))


def activate(item: Effect, values: Mapping[str, Value], scale: Scale = REFERENCE_SCALE
             ) -> ActiveEffect:
    """Return an effect with values by parameter, null where not given; floats or arrays (n,).

    scale: of the car, by which the intervals of the parameters are.

    Raises UsageError for an unknown parameter, ConfigError for a value that is
    out of its bounds or no number.
    """
    names = [q.name for q in item.parameters]
    for key in values:
        if key not in names:
            raise UsageError(f"the effect {item.name} has no parameter {key!r}", found=key,
                             expected=", ".join(names), remedy=f"write {names[0]} for {key}")
    for q in effect_at_scale(item, scale).parameters:
        number = np.asarray(values.get(q.name, q.null), dtype=float)
        if not np.all((number >= q.low) & (number <= q.high)):
            raise ConfigError(f"{item.name}.{q.name} = {values[q.name]!r} is out of range",
                              found=f"{values[q.name]!r} {q.unit}",
                              expected=f"{q.low} to {q.high} {q.unit}",
                              remedy="check the unit: SI units and radians")
    return ActiveEffect(item, tuple(values.get(q.name, q.null) for q in item.parameters))


def apply(p: Vehicle, name: str, **values: Value) -> Vehicle:
    """The vehicle with an effect of the catalogue, in place of the same one if it has it.

    Raises UsageError for an unknown effect or parameter, ConfigError for a
    value out of its bounds.
    """
    return add_effects(p, (activate(find_effect(name), values, find_scale(p.body)),))


def add_effects(p: Vehicle, more: Iterable[ActiveEffect]) -> Vehicle:
    """Return the vehicle with more effects, sorted in the order in which they act."""
    every = {a.name: a for a in (*p.effects, *more)}
    return replace(p, effects=tuple(sorted(every.values(), key=lambda a: order_key(a.effect))))


def add_null_effects(p: Vehicle, effects: Iterable[ActiveEffect]) -> Vehicle:
    """Return the vehicle with the effects that it lacks, at their null values."""
    has = {a.name for a in p.effects}
    return add_effects(p, [activate(find_effect(a.name), {}) for a in effects if a.name not in has])


def remove_effects(p: Vehicle, names: Collection[str]) -> Vehicle:
    """Return the vehicle without some effects, given by name; others are ignored.

    >>> from dart_hal.vehicle import PAPER
    >>> remove_effects(apply(PAPER, "grip", k=0.1), ["grip"]) == PAPER
    True
    """
    return replace(p, effects=tuple(a for a in p.effects if a.name not in names))


def order_key(item: Effect) -> tuple[int, bool, str]:
    """Return the sort key of an effect: stage from command to sensor, delays last in a stage.

    The order of a vehicle's effects does not depend on the order in which they were given.
    """
    late = any(isinstance(signal, PureDelay) for signal in item.signals.values())
    return EFFECT_STAGES.index(item.stage), late, item.name


def parse_effects(text: str) -> tuple[ActiveEffect, ...]:
    """Effects from ``steering_lag:0.06,encoder_ring:missing=0.05:phase=0.2``.

    Values without a name are in the order of the effect's parameters. Raises
    UsageError for text that cannot be read, ConfigError out of bounds.
    """
    return tuple(_parse_effect(part.strip()) for part in text.split(",") if part.strip())


def _parse_effect(text: str) -> ActiveEffect:
    name, *given = (part.strip() for part in text.split(":"))
    item = find_effect(name)
    values: dict[str, Value] = {}
    for i, entry in enumerate(given):
        key, equals, number = entry.rpartition("=")
        if not equals and i >= len(item.parameters):
            raise _unreadable_effect(item, text)
        key = key if equals else item.parameters[i].name
        try:
            values[key.strip()] = float(number)
        except ValueError as error:
            raise _unreadable_effect(item, text) from error
    if not values or len(values) < len(given):
        raise _unreadable_effect(item, text)
    return activate(item, values)


def _unreadable_effect(item: Effect, text: str) -> UsageError:
    form = ":".join(f"{q.name}={q.sizes[1]:g}" for q in item.parameters)
    return UsageError(f"an effect that cannot be read: {text!r}", found=text,
                      expected=f"{item.name}:{form}",
                      remedy=f"write {item.name}:{item.parameters[0].sizes[1]:g}")
