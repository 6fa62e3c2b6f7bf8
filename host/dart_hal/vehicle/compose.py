"""How the effects of a vehicle enter its equations: as parameters, forces or signals."""

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
    """Apply the effects that are a change of parameters, and drop them from the vehicle.

    The other effects remain. The function is idempotent.
    """
    effects = p.effects
    if all(a.effect.vehicle is None and (a.effect.force or a.effect.signals) for a in effects):
        return p
    for applied in effects:
        if applied.effect.vehicle is not None:
            p = applied.effect.vehicle(p, *applied.values)
    remaining = tuple(_without_vehicle_hook(a) for a in effects
                      if a.effect.force or a.effect.signals)
    return replace(p, effects=remaining)


def keep_motion_effects(p: Vehicle) -> Vehicle:
    """Return the vehicle of the motion step: parameters applied, only effects on forces."""
    q = apply_parameter_effects(p)
    return replace(q, effects=tuple(a for a in q.effects if a.effect.force)) if q.effects else q


def force_hooks(p: Vehicle, xp: Any) -> tuple[Hook, ...]:
    """Return the force hooks of a vehicle whose parameter effects were applied, in order."""
    f = adapt(xp)
    return tuple(a.effect.force(p, f, *a.values) for a in p.effects if a.effect.force)


def signals(p: Vehicle, channel: str) -> tuple[tuple[ActiveEffect, Signal], ...]:
    """Return the effects that change a signal, in order."""
    return tuple((a, a.effect.signals[channel]) for a in p.effects
                 if channel in a.effect.signals)


def _without_vehicle_hook(applied: ActiveEffect) -> ActiveEffect:
    if applied.effect.vehicle is None:
        return applied
    return ActiveEffect(_drop_vehicle_hook(applied.effect), applied.values)


@cache
def _drop_vehicle_hook(effect: Effect) -> Effect:
    """Return one cached copy per effect: kernels are looked up by identity."""
    return replace(effect, vehicle=None)
