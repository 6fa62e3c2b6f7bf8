"""Sizes of a car in a model: wheelbase, centre of mass, mass, inertia, drive, lock of car.toml.

A shipped parameter set is of DART. Where a car is named, its own sizes take the place of DART's
before anything is fitted or predicted, and forces that were not measured are scaled with them.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

import msgspec
import numpy as np

from dart_hal.core.config import ModelFile, Quantity, plain
from dart_hal.core.config.car import CarConfig, CommandLimits, Geometry
from dart_hal.core.config.model import Parameter, Parameters
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import (
    MOTOR_FORMS,
    AxleTyres,
    Body,
    Friction,
    PaperTyres,
    Steering,
)
from dart_hal.vehicle.scale import Scale, find_scale, scale_of_sizes
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

# Entries of the section body that a car file gives, with their units.
SIZES = {"wheelbase": "m", "l_f": "m", "l_r": "m", "mass": "kg", "yaw_inertia": "kg m2"}
# First word of ``method`` of a size whose standard error car.toml states; fits may move it.
CAR_FILE = "car.toml"
# Relative; sizes that differ by less are the same car's, weighed or measured twice.
MIN_SIZE_DIFFERENCE = 0.01
# Standard errors of a difference of two sizes of one car: 1 in 100 is larger.
MAX_SIZE_STDS = 2.58


def body_of(size: Geometry, base: Body = PAPER.body) -> Body:
    """Body of a car with the geometry of its car.toml.

    A yaw inertia that is not stated is that of the base by its shape, I_z / (m l_f l_r).
    """
    # The yaw inertia of similar bodies is proportional to m l_f l_r.
    shape = base.yaw_inertia / (base.mass * base.l_f * base.l_r)
    inertia = size.yaw_inertia or shape * size.mass * size.l_f * size.l_r
    return replace(base, wheelbase=size.l_f + size.l_r, l_f=size.l_f, l_r=size.l_r,
                   mass=size.mass, yaw_inertia=inertia)


def set_sizes(model: ModelFile, size: Geometry) -> ModelFile:
    """The model with the sizes of a car, and with their standard errors where it states them.

    Entries with a standard error that is not from a car.toml were measured and stay. All others
    with a unit of force or length are scaled with the car: friction, motor, tyres.
    """
    body = body_of(size)
    errors = size.std.to_dict()
    measured = {key for key, entry in model.body.items()
                if isinstance(entry, Quantity) and not is_from_car_file(entry)}
    # Lengths have to close, wheelbase = l_f + l_r: they are kept all three or not at all.
    geometry = {"wheelbase", "l_f", "l_r"}
    kept = measured - geometry if not geometry <= measured else measured
    changed: Parameters = {
        key: Quantity(getattr(body, key), errors[key], CAR_FILE) if key in errors else
        getattr(body, key) for key in SIZES if key not in kept}
    if size.front_share is not None:
        changed["front_share"] = size.front_share
    return msgspec.structs.replace(scale_forces(model, size), body={**model.body, **changed})


def scale_forces(model: ModelFile, size: Geometry) -> ModelFile:
    """The model with friction, motor and tyres of a similar car of that size."""
    old = model.values("body")
    before = scale_of_sizes(old["wheelbase"], old["mass"])
    after = find_scale(size)
    if before == after:
        return model
    ratio = Scale(after.length / before.length, after.force / before.force)
    motor = MOTOR_FORMS[model.forms.get("motor", "duty")]
    units = {f.name: str(f.metadata["unit"]) for group in (Friction, motor, PaperTyres)
             for f in fields(group)}
    relative = {f.name for f in fields(AxleTyres)} if "rear_D" in model.tyres else set()
    scaled = {section: {key: entry if isinstance(entry, Quantity) or key in relative
                        else ratio.factor(units[key]) * entry
                        for key, entry in getattr(model, section).items()}
              for section in ("friction", "motor", "tyres")}
    return msgspec.structs.replace(model, **scaled)


def is_drive_assumed(size: Geometry) -> bool:
    """Whether a car is not DART, which drives all wheels, and does not state ``front_share``."""
    other = abs(size.wheelbase - PAPER.body.wheelbase) > MIN_SIZE_DIFFERENCE * PAPER.body.wheelbase
    return other and size.front_share is None


def is_from_car_file(entry: Parameter) -> bool:
    """Whether a size has a standard error that its owner states in car.toml."""
    return isinstance(entry, Quantity) and (entry.method or "").startswith(CAR_FILE)


def list_stated_errors(model: ModelFile) -> dict[str, float]:
    """Standard errors of sizes that car.toml states, by full name ("body.mass")."""
    return {f"body.{key}": float(entry.std) for key, entry in model.body.items()
            if isinstance(entry, Quantity) and is_from_car_file(entry)}


def find_steering_lock(car: CarConfig) -> float | None:
    """Return ``limits.max_steering`` [rad] of a car, None where its car.toml states none."""
    lock = car.limits.max_steering
    return None if lock == CommandLimits().max_steering else lock


def scale_steering_lock(model: ModelFile, lock: float) -> ModelFile:
    """Return the model with a steering lock [rad]: a start of a fit.

    Both amplitudes of the steering map are scaled so that the mean of the angles at full
    command is the lock.
    """
    values = model.values("steering")
    names = {"k_left", "a_left_rad", "s0", "a_right_rad", "k_right"}
    if set(values) != names:
        return model
    # The map is proportional to its amplitudes, so one factor gives the stated lock.
    ends = make_steering(Steering(**values), ARRAY)(np.array([1.0, -1.0]))
    factor = lock / float(np.mean(np.abs(ends)))
    scaled: Parameters = {key: factor * values[key] for key in ("a_left_rad", "a_right_rad")}
    return msgspec.structs.replace(model, steering={**model.steering, **scaled})


def list_differences(model: ModelFile, size: Geometry) -> list[str]:
    """Sizes in which a model differs from a car, as sentences of one clause.

    By more than MIN_SIZE_DIFFERENCE, and by more than their stated errors allow: a fit may move a
    size within its error, and writes where it is.
    """
    body = body_of(size)
    errors = size.std.to_dict()
    found = []
    for key, unit in SIZES.items():
        if key not in model.body or (key == "yaw_inertia" and size.yaw_inertia is None):
            continue
        entry = model.body[key]
        stored = plain(entry)
        size_of_car = getattr(body, key)
        std = math.hypot(errors.get(key, 0.0), (isinstance(entry, Quantity) and entry.std) or 0.0)
        allowed = max(MIN_SIZE_DIFFERENCE * abs(size_of_car), MAX_SIZE_STDS * std)
        if abs(stored - size_of_car) > allowed:
            found.append(f"{key} {stored:.4g} {unit} and not {size_of_car:.4g}")
    share = model.values("body").get("front_share", PAPER.body.front_share)
    if size.front_share is not None and size.front_share != share:
        found.append(f"front_share {share:g} and not {size.front_share:g}")
    return found


def describe_sizes(model: ModelFile) -> str:
    """The sizes of a model in words."""
    return ", ".join(f"{key} {plain(model.body[key]):.4g} {unit}" for key, unit in SIZES.items()
                     if key in model.body)
