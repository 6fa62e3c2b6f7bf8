"""Sizes of a car of which little is known, from a tape measure and scales.

With wheelbase L, mass m, loads m_f and m_r of the axles [kg]:

    l_f = L m_r / (m_f + m_r)          centre of mass behind the front axle
    I_z = SHAPE m l_f l_r              yaw inertia, if it is not measured

Errors are standard errors. They are taken as independent and are propagated to first order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec

from dart_hal.core.config import CarConfig, Quantity, parse_config
from dart_hal.core.config.car import Geometry, SizeErrors
from dart_hal.core.config.folders import read_config
from dart_hal.core.config.write import archive_version, replace, save
from dart_hal.core.errors import ConfigError
from dart_hal.vehicle.sizes import SIZES, body_of

# I_z / (m l_f l_r): geometric mean and relative standard deviation of six published cars between
# 41 g and 1.2 t, see docs/reference/car-files.md. Model cars have 0.46 to 0.71, road cars about 1.
SHAPE = 0.69
SHAPE_STD = 0.31
# Standard errors; axle loads that differ from the mass by more are of two cars, or one is wrong.
MAX_LOAD_DIFFERENCE = 3.0


@dataclass(frozen=True, slots=True)
class MeasuredSizes:
    """Sizes of a car with standard errors, in m, kg and kg m2, by key of ``[geometry]``.

    max_steering [rad]: largest angle of the road wheels. estimated: keys that are not measured.
    front_share: of the wheel force at the front axle, None where it is not known.
    """

    sizes: dict[str, Quantity]
    max_steering: Quantity
    estimated: tuple[str, ...] = ()
    front_share: float | None = None

    def geometry(self) -> Geometry:
        """Return the section ``[geometry]`` of car.toml."""
        value = {key: _round(self.sizes[key].value) for key in SIZES if key in self.sizes}
        # Either l_f or l_r was measured: the other one closes the wheelbase.
        if "l_r" not in value:
            value["l_r"] = _round(value["wheelbase"] - value["l_f"])
        elif "l_f" not in value:
            value["l_f"] = _round(value["wheelbase"] - value["l_r"])
        errors = {key: float(f"{size.std:.3g}") for key, size in self.sizes.items()}
        return Geometry(**value, front_share=self.front_share, std=SizeErrors(**errors))


def add_loads(front: Quantity, rear: Quantity) -> Quantity:
    """Return the mass [kg] of a car from the loads of its axles [kg]."""
    return Quantity(front.value + rear.value, math.hypot(front.std, rear.std))


def check_loads(front: Quantity, rear: Quantity, mass: Quantity) -> None:
    """Raise ConfigError for axle loads that do not add up to the mass."""
    total = add_loads(front, rear)
    limit = MAX_LOAD_DIFFERENCE * math.hypot(total.std, mass.std)
    if abs(total.value - mass.value) > limit:
        raise ConfigError(
            "the axle loads do not add up to the mass",
            found=f"{front.value:g} + {rear.value:g} = {total.value:g} kg, and a mass of "
                  f"{mass.value:g} kg",
            expected=f"a difference of at most {limit:.3g} kg, three standard errors",
            remedy="weigh again with the car level and ready to drive, or leave out the mass")


def locate_centre_of_mass(wheelbase: Quantity, front: Quantity, rear: Quantity) -> Quantity:
    """Return l_f [m]: distance of the centre of mass behind the front axle, from axle loads."""
    total = front.value + rear.value
    share = rear.value / total
    share_std = math.hypot(front.value * rear.std, rear.value * front.std) / total**2
    return Quantity(share * wheelbase.value,
                    math.hypot(share * wheelbase.std, wheelbase.value * share_std))


def estimate_yaw_inertia(wheelbase: Quantity, distance: Quantity, mass: Quantity) -> Quantity:
    """Return I_z = SHAPE m l_f l_r [kg m2] with the spread of cars as its error.

    distance: l_f or l_r [m].
    """
    a = distance.value
    b = wheelbase.value - a
    inertia = SHAPE * mass.value * a * b
    # With b = L - a: d ln(a b) = (1 / a - 1 / b) da + dL / b.
    return Quantity(inertia, inertia * math.hypot(
        SHAPE_STD, mass.std / mass.value, (1.0 / a - 1.0 / b) * distance.std, wheelbase.std / b))


def describe_car(name: str, measured: MeasuredSizes) -> str:
    """Return the text of a new car.toml. Raises ConfigError for sizes that no car has."""
    body = measured.geometry()
    errors = body.std.to_dict()

    def line(key: str, meaning: str, size: Quantity | float | None) -> str:
        return f"{f'{key} = {size}':<24} # {meaning}"

    meanings = {"wheelbase": "m, axle to axle", "l_f": "m, centre of mass to the front axle",
                "l_r": "m, centre of mass to the rear axle", "mass": "kg, ready to drive",
                "yaw_inertia": "kg m2" + f", estimated: {SHAPE:g} m l_f l_r" * (
                    "yaw_inertia" in measured.estimated)}
    drive = () if body.front_share is None else (
        line("front_share", "of the wheel force at the front axle", body.front_share),)
    lock = measured.max_steering
    text = "\n".join([
        "# A car that is known by recordings. docs/reference/car-files.md describes all keys.",
        "# To drive it by this program, add [encoder] metres_per_edge and check [pwm], [steering]",
        "# and [throttle] against cars/dart-01/car.toml.",
        'schema = "dart-hal/car/1"', f'name = "{name}"', "", "[geometry]",
        *(line(key, meaning, getattr(body, key)) for key, meaning in meanings.items()), *drive, "",
        "[geometry.std]           # standard errors: fits move a size within them",
        *(f"{key} = {std}" for key, std in errors.items()), "", "[limits]",
        line("max_steering", f"rad at the road wheels, +- {lock.std:g}", lock.value), ""])
    check_description(parse_config(text, f"{name}/car.toml"), f"{name}/car.toml")
    return text


def write_car(path: Path, name: str, measured: MeasuredSizes) -> bool:
    """Write car.toml; return whether it was there.

    The older version goes to history/, and its other keys and comments stay. Raises ConfigError
    for an older file that cannot be read, and as ``describe_car``.
    """
    text = describe_car(name, measured)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        replace(path, text)
        return False
    old = read_config(path)
    new = {key: getattr(measured.geometry(), key) for key in (*SIZES, "std")}
    if measured.front_share is not None:
        new["front_share"] = measured.front_share
    limits = msgspec.structs.replace(old.limits, max_steering=measured.max_steering.value)
    changed = msgspec.structs.replace(
        old, name=name, geometry=msgspec.structs.replace(old.geometry, **new), limits=limits)
    if changed == parse_config(text, str(path)):  # nothing but these sizes: no comment gets stale
        archive_version(path)
        replace(path, text)
    else:
        save(changed, path)
    return True


def check_description(car: CarConfig, origin: str) -> None:
    """Raise ConfigError for sizes that do not suit each other, such as grams for kilograms."""
    try:
        body_of(car.geometry)
    except ConfigError as error:
        raise ConfigError(f"{origin}: {error.what}", found=error.found, expected=error.expected,
                          remedy=error.remedy) from error


def _round(value: float) -> float:
    return float(f"{value:.7g}")
