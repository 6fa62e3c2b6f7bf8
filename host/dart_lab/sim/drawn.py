"""The simulated car of a ``sim://`` URL: drawn from the seed, with a vehicle and effects."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dart_hal.core.errors import UsageError
from dart_hal.core.url import URLS, Url
from dart_hal.vehicle import PAPER, Body
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import add_effects, parse_effects
from dart_hal.vehicle.load import find_model
from dart_lab.sim.battery import NOMINAL_VOLTAGE, parse_battery
from dart_lab.sim.hidden import HiddenCar, hidden_car
from dart_lab.sim.sealed import SealedCar, sealed_in
from dart_lab.sim.true_car import affects_mocap_only, apply_effects, replace_vehicle


@dataclass(frozen=True, slots=True)
class ResolvedCar:
    """The car of a URL: ``base`` without effects, ``true`` with them.

    effects: those of the URL and of the vehicle file; model: "dynamic" or "kinematic"; body: as
    measured by its builder; notices: parts of the file that have no effect here.
    """

    base: HiddenCar
    true: HiddenCar
    effects: tuple[ActiveEffect, ...]
    model: str
    body: Body
    notices: tuple[str, ...] = ()


def resolve_car(url: Url) -> ResolvedCar:
    """Return the car of a URL.

    Raises UsageError for bad options, ConfigError for a bad file or value.
    """
    sealed = sealed_in(url)
    if sealed is not None:
        return _resolve_sealed(sealed)
    car = hidden_car(_parse_seed(url), parse_choice(url, "ring", "even", "hidden"))
    named = url.options.get("vehicle")
    p = None
    if named is not None:
        p = find_model(named)[1]
        car = replace_vehicle(car, p)
    model, renamed = _parse_physics(url, p.kind if p else "dynamic")
    file_effects = p.effects if p else ()
    measured = parse_battery(url.options.get("battery", "0")) is not None
    # A file with battery_fade but without the voltage has it by time, and keeps that.
    if measured and car.vehicle.motor_voltage is None and all(
            a.name != "battery_fade" for a in file_effects):
        car = replace(car, vehicle=replace(car.vehicle, motor_voltage=NOMINAL_VOLTAGE))
    ignored = tuple(a.name for a in file_effects if affects_mocap_only(a))
    effects = _combine_effects(url, tuple(a for a in file_effects if not affects_mocap_only(a)))
    notice = (f"effects on a motion capture are left out: {', '.join(ignored)} of {named}",)
    notices = renamed + (notice if ignored else ())
    if not measured and car.vehicle.motor_voltage is not None and any(
            a.name == "battery_fade" for a in effects):
        notices += ("battery_fade follows the voltage of the battery, because the vehicle states "
                    "motor_voltage, but this car has no battery=..., so the effect is left out",)
    return ResolvedCar(car, apply_effects(car, effects, model), effects, model,
                       p.body if p else PAPER.body, notices)


def _resolve_sealed(sealed: SealedCar) -> ResolvedCar:
    """Return a sealed car: drawn like any other, under a name without its seed."""
    drawn = hidden_car(sealed.seed)
    car = replace(drawn, label=sealed.name, vehicle=replace(drawn.vehicle, name=sealed.name))
    effects = parse_effects(sealed.effect)
    return ResolvedCar(car, apply_effects(car, effects, "dynamic"), effects, "dynamic", PAPER.body)


def _parse_physics(url: Url, default: str) -> tuple[str, tuple[str, ...]]:
    """Return the physics of a URL, and a notice if its option has the name of version 0.1."""
    old = "model" in url.options
    if old and "physics" in url.options:
        raise UsageError("physics is given twice", found=url.text,
                         expected="physics=; model= is its old name")
    name = "model" if old else "physics"
    notice = ("model= is now called physics=; the next version no longer accepts it",)
    return parse_choice(url, name, "dynamic", "kinematic") or default, notice if old else ()


def _combine_effects(url: Url, file_effects: tuple[ActiveEffect, ...]) -> tuple[ActiveEffect, ...]:
    """Return the effects of the option and of the vehicle file, in the order in which they act."""
    given = parse_effects(url.options.get("effect", ""))
    used = [a.name for a in (*given, *file_effects)]
    twice = sorted({name for name in used if used.count(name) > 1})
    if twice:
        raise UsageError(f"{', '.join(twice)} is given twice", found=url.text,
                         expected="every effect once, in the URL or in the file of the vehicle")
    return add_effects(replace(PAPER, effects=file_effects), given).effects


def _parse_seed(url: Url) -> int:
    text = url.options.get("seed", "0")
    if not text.isascii() or not text.isdigit():
        raise UsageError(f"seed={text} is no seed", found=url.text,
                         expected="a whole number from 0 up", remedy=URLS)
    return int(text)


def parse_choice(url: Url, name: str, *allowed: str) -> str | None:
    """Return the value of an option, None without it. Raises UsageError for another value."""
    value = url.options.get(name)
    if value is not None and value not in allowed:
        raise UsageError(f"{name}={value!r}", found=url.text, expected=" or ".join(allowed),
                         remedy=URLS)
    return value
