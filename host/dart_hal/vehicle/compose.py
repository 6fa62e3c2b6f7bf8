"""How the effects of a vehicle enter its equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

from dart_hal.vehicle.effect import ActiveEffect, Effect, Forces, Signal
from dart_hal.vehicle.namespace import adapt
from dart_hal.vehicle.parameters import Vehicle

Hook = Callable[[Forces], Forces]


def apply_parameter_effects(p: Vehicle) -> Vehicle:
    """The vehicle with those effects in its parameters that are a change of parameters.

    The others stay. To do it twice changes nothing more.
    """
    effects = p.effects
    if all(a.effect.vehicle is None and (a.effect.force or a.effect.signals) for a in effects):
        return p
    for applied in effects:
        if applied.effect.vehicle is not None:
            p = applied.effect.vehicle(p, *applied.values)
    left = tuple(_without_vehicle_hook(a) for a in effects if a.effect.force or a.effect.signals)
    return replace(p, effects=left)


def keep_motion_effects(p: Vehicle) -> Vehicle:
    """The vehicle as its step knows it: settled, and without effects on signals alone."""
    q = apply_parameter_effects(p)
    return replace(q, effects=tuple(a for a in q.effects if a.effect.force)) if q.effects else q


def force_hooks(p: Vehicle, xp: Any) -> tuple[Hook, ...]:
    """What the effects of a settled vehicle do to its forces, in their order."""
    f = adapt(xp)
    return tuple(a.effect.force(p, f, *a.values) for a in p.effects if a.effect.force)


def signals(p: Vehicle, channel: str) -> tuple[tuple[ActiveEffect, Signal], ...]:
    """The effects that change a signal, in their order."""
    return tuple((a, a.effect.signals[channel]) for a in p.effects
                 if channel in a.effect.signals)


def _without_vehicle_hook(applied: ActiveEffect) -> ActiveEffect:
    if applied.effect.vehicle is None:
        return applied
    return ActiveEffect(_drop_vehicle_hook(applied.effect), applied.values)


@cache
def _drop_vehicle_hook(of: Effect) -> Effect:
    """The same one every time: a kernel is looked up by it."""
    return replace(of, vehicle=None)
