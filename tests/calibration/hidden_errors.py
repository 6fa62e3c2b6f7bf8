"""Errors of the measuring procedures on hidden cars, beside the errors that they state."""

from __future__ import annotations

import tempfile
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from dart_hal.calibration.clock import calibrate_clock
from dart_hal.calibration.encoder import calibrate_encoder
from dart_hal.calibration.esc import calibrate_esc
from dart_hal.calibration.imu import calibrate_imu
from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.measured import Measured
from dart_hal.calibration.mocap import calibrate_mocap
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.calibration.throttle import calibrate_throttle
from dart_hal.car import Car
from dart_hal.config import DriveTable, Quantity
from dart_hal.links.base import Url, open_backend
from dart_hal.ports import Workshop
from dart_hal.sim.truth import reveal, reveal_url
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.parameters import Friction, Motor

VERBS: dict[str, Callable[[Car, Workshop], Measured]] = {
    "clock": lambda car, workshop: calibrate_clock(car),
    "encoder": calibrate_encoder, "imu": calibrate_imu, "esc": calibrate_esc,
    "throttle": calibrate_throttle,
    "circle": lambda car, workshop: calibrate_throttle(car, workshop, room=0.0),
    "latency": lambda car, workshop: calibrate_latency(car),
    "mocap": lambda car, workshop: calibrate_mocap(car)}


def url_of(seed: int, mocap: bool = False, late: bool = True) -> str:
    """The hidden car of a seed; ``late``: with a delay and a lag of its motor."""
    url = f"sim://?seed={seed}&nano=mock&mocap={int(mocap)}"
    if not late:
        return url
    rng = np.random.default_rng([seed, 500])
    delay, lag = rng.uniform(0.0, 0.04), rng.uniform(0.015, 0.1)
    return f"{url}&effect=throttle_delay:{delay:.4f},throttle_lag:{lag:.4f}"


def true_sensors(url: str) -> dict[str, float]:
    """The truth of ``sim --reveal`` with the effects of the URL on top."""
    found = reveal_url(Url.parse(url))
    sensors = dict(found["sensors"])
    for effect in found["effects"]:
        name = {"throttle_delay": "latency.pulse_to_wheel",
                "throttle_lag": "latency.pulse_to_wheel_lag"}[effect["name"]]
        sensors[name] += next(iter(effect["parameters"].values()))["value"]
    return sensors


def errors(verb: str, seed: int) -> dict[str, tuple[float, float]]:
    """(error, standard error) of each scalar quantity of one hidden car."""
    url = url_of(seed, verb == "mocap", verb == "latency")
    with tempfile.TemporaryDirectory() as folder:
        if verb == "latency":
            with Car.open(url, cars=folder) as car:
                calibrate_steering(car)
        backend = open_backend(url)
        with Car.over(backend, cars=folder) as car:
            found = VERBS[verb](car, backend.workshop)
    true = true_sensors(url)
    scalars = {name: (q.value - true[name], q.std) for name, q in found.quantities.items()
               if isinstance(q, Quantity)}
    return scalars | drive_errors(seed, found)


def drive_errors(seed: int, found: Measured) -> dict[str, tuple[float, float]]:
    """(error, standard error) [us] of each point of a drive table, by its place in it."""
    table = found.others.get("throttle.drive")
    if not isinstance(table, DriveTable):
        return {}
    rows = zip(table.speed, table.pulse_us, table.std_us, strict=True)
    where = found.notes[0].rpartition(", ")[2]
    return {f"throttle.drive[{k}] {where}": (pulse - holding_pulse(seed, speed), std)
            for k, (speed, pulse, std) in enumerate(rows)}


def holding_pulse(seed: int, speed: float) -> float:
    """The pulse [us] that holds a speed [m/s] straight ahead on a hidden car."""
    shown = reveal(seed)
    motor, friction = ({key: q["value"] for key, q in shown["vehicle"][group].items()}
                       for group in ("motor", "friction"))
    drive = make_drive(Motor(**motor), Friction(**friction))
    throttle = brentq(lambda tau: drive(tau, speed), 0.1, 1.0)
    sensors = shown["sensors"]
    return float(sensors["throttle.neutral_us"] + sensors["throttle.saturation_us"] * throttle)
