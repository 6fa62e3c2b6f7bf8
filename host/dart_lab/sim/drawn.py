"""Which car a ``sim://`` URL means: drawn by its seed, of a vehicle, with effects."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dart_hal.core.errors import UsageError
from dart_hal.core.url import URLS, Url
from dart_hal.vehicle import PAPER, Body
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import add_effects, parse_effects
from dart_hal.vehicle.load import find_model
from dart_lab.sim.hidden import HiddenCar, hidden_car
from dart_lab.sim.true_car import only_mocap, with_effects, with_vehicle


@dataclass(frozen=True, slots=True)
class Drawn:
    """The car of a URL: without effects, as it really is, its effects, and how it moves.

    body: what its builder has measured; notices: what of a file it cannot have.
    """

    base: HiddenCar
    true: HiddenCar
    effects: tuple[ActiveEffect, ...]
    model: str
    body: Body
    notices: tuple[str, ...] = ()


def car_of(url: Url) -> Drawn:
    """Raises UsageError for bad options, ConfigError for a bad file or value."""
    car = hidden_car(_seed(url), choice(url, "ring", "even", "hidden"))
    named, p = url.options.get("vehicle"), None
    if named is not None:
        p = find_model(named)[1]
        car = with_vehicle(car, p)
    model, renamed = _physics(url, p.kind if p else "dynamic")
    of_file = p.effects if p else ()
    unseen = tuple(a.name for a in of_file if only_mocap(a))
    effects = _effects(url, tuple(a for a in of_file if not only_mocap(a)))
    lacking = (f"sim:// has no motion capture: the car is without {', '.join(unseen)} of {named}",)
    return Drawn(car, with_effects(car, effects, model), effects, model,
                 p.body if p else PAPER.body, renamed + (lacking if unseen else ()))


def _physics(url: Url, usual: str) -> tuple[str, tuple[str, ...]]:
    """How the car moves, and the notice that its option is still called as in version 0.1."""
    old = "model" in url.options
    if old and "physics" in url.options:
        raise UsageError("physics is given twice", found=url.text,
                         expected="physics=; model= is its old name")
    name = "model" if old else "physics"
    notice = ("model= is now called physics=; the next version no longer knows it",)
    return choice(url, name, "dynamic", "kinematic") or usual, notice if old else ()


def _effects(url: Url, of_file: tuple[ActiveEffect, ...]) -> tuple[ActiveEffect, ...]:
    """Those of the option ``effect`` with those of the file, in the order in which they act."""
    given = parse_effects(url.options.get("effect", ""))
    every = [a.name for a in (*given, *of_file)]
    twice = sorted({name for name in every if every.count(name) > 1})
    if twice:
        raise UsageError(f"{', '.join(twice)} is given twice", found=url.text,
                         expected="every effect once, in the URL or in the file of the vehicle")
    return add_effects(replace(PAPER, effects=of_file), given).effects


def _seed(url: Url) -> int:
    text = url.options.get("seed", "0")
    if not text.isascii() or not text.isdigit():
        raise UsageError(f"seed={text} is no seed", found=url.text,
                         expected="a whole number from 0 up", remedy=URLS)
    return int(text)


def choice(url: Url, name: str, *allowed: str) -> str | None:
    """The value of an option, None without it. Raises UsageError for another value."""
    value = url.options.get(name)
    if value is not None and value not in allowed:
        raise UsageError(f"{name}={value!r}", found=url.text, expected=" or ".join(allowed),
                         remedy=URLS)
    return value
