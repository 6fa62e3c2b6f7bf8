"""Drives of simulated cars, and what is true about them in the terms of a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, parse_car
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import make_acceleration, make_steering
from dart_lab.identification.experiment.floor import Floor
from dart_lab.identification.experiment.handover import (
    ExperimentOutcome,
    find_mass,
    fit_run,
    note_mass,
)
from dart_lab.identification.experiment.make import conduct, make_plan
from dart_lab.identification.experiment.runner import ExperimentDrive
from dart_lab.identification.fit import SubmodelFit
from dart_lab.sim.car_file import car_toml
from dart_lab.sim.hidden import HiddenCar, hidden_car

FLOOR = {"friction": "10x3", "motor": "12x3", "steering": "8", "delay": "7", "tyres": "5"}


@dataclass(frozen=True)
class Driven:
    """One experiment on one hidden car."""

    drive: ExperimentDrive
    outcome: ExperimentOutcome
    files: CarFiles
    truth: HiddenCar
    path: object

    @property
    def fit(self) -> SubmodelFit:
        return self.outcome.fits[self.drive.plan.name]


def true_values(car: HiddenCar) -> dict[str, float]:
    """As a fit sees them: throttle is the pulse of car.toml (1500 us + 450 us), not the ESC's."""
    v, esc = car.vehicle, car.esc
    share = 450.0 / esc.saturation_us
    return {"a": v.friction.a, "b": v.friction.b, "c": v.friction.c,
            "d": v.motor.d * share, "e": v.motor.e * share,
            "g": v.motor.g / share + (1500.0 - esc.neutral_us) / 450.0,
            **{k: getattr(car.servo.curve, k) for k in
               ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right")}}


def steady_angle(vehicle, delta: float, lateral: float) -> tuple[float, float]:
    """(atan(l omega / v), lateral acceleration) in a steady turn of the whole car."""
    rates = make_acceleration(vehicle)
    vx, vy, om, tau, dt = 0.8, 0.0, 0.8, 0.25, 0.002
    for _ in range(9000):
        ax, ay, turn = rates(vx, vy, om, tau, delta)
        vx, vy, om = vx + ax * dt, vy + ay * dt, om + turn * dt
        tau += 0.05 * (lateral - vx * om - 2.0 * (ax * om + vx * turn)) * dt
    return math.atan2(vehicle.body.wheelbase * om, vx), vx * om


def slope_of(vehicle, delta: float, low: float, high: float) -> float:
    """Loss of turn per lateral acceleration [rad/(m/s2)] between two of them [m/s2]."""
    (a, at_a), (b, at_b) = (steady_angle(vehicle, delta, lat) for lat in (low, high))
    return -(b - a) / (at_b - at_a)


@pytest.fixture
def experiment(tmp_path):
    """``experiment(name, seed, nano)`` -> Driven. nano: the rest of the URL, too (QUICK)."""
    def run(name: str, seed: int, nano: str = "mock") -> Driven:
        backend = open_backend(f"sim://?seed={seed}&nano={nano}")
        path = tmp_path / f"{name}-{seed}.mcap"
        with Car.over(backend, cars=tmp_path, record=path) as car:
            plan = make_plan(name, car.files, Floor.parse(FLOOR[name]), None)
            mass = find_mass(car.files, None, backend.workshop)
            note_mass(car, mass)
            drive = conduct(car, plan)
            files = car.files
        return Driven(drive, fit_run(path, name, files, mass), files, hidden_car(seed), path)
    return run


@pytest.fixture(scope="session")
def files(tmp_path_factory) -> CarFiles:
    """The files of the nominal car."""
    return parse_car(car_toml(hidden_car(0)), "sim://", [tmp_path_factory.mktemp("cars")])


@pytest.fixture
def misses():
    """``misses(fit, truth)`` -> by parameter, how many standard errors the truth is away."""
    def relative_errors(fit: SubmodelFit, truth: dict[str, float]) -> dict[str, float]:
        return {n: (e.value - truth[n]) / e.std for n, e in fit.parameters.items()
                if n in truth and e.identifiable and np.isfinite(e.std)}
    return relative_errors


@pytest.fixture
def truth_of():
    return true_values


@pytest.fixture
def true_slope():
    """``true_slope(car, command, low, high)`` of a hidden car at a steering command."""
    return lambda car, command, low, high: slope_of(
        car.vehicle, make_steering(car.servo.curve)(command), low, high)
