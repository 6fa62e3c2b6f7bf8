"""Errors of the measuring procedures on hidden cars, beside the errors that they state."""

from __future__ import annotations

import tempfile
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from dart_hal.calibration import esc, order
from dart_hal.calibration.clock import calibrate_clock
from dart_hal.calibration.encoder import calibrate_encoder
from dart_hal.calibration.esc import calibrate_esc
from dart_hal.calibration.imu import calibrate_imu
from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.lidar import calibrate_lidar
from dart_hal.calibration.measured import Measured
from dart_hal.calibration.mocap import calibrate_mocap
from dart_hal.calibration.procedure import agree, silent
from dart_hal.calibration.result import SteeringResult
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.calibration.throttle import calibrate_throttle
from dart_hal.car import Car
from dart_hal.cli.common.calibrate_all import write
from dart_hal.core.config import CarFiles, DriveTable
from dart_hal.core.ports import Workshop
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import Map, map_of_lines
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.parameters import Friction, Motor
from dart_lab.sim.truth import reveal, reveal_url
from studies.calibration.real_parts import filtered_gyro, host_second, in_seconds, rear_bend

VERBS: dict[str, Callable[[Car, Workshop], Measured | SteeringResult]] = {
    "clock": lambda car, workshop: calibrate_clock(car),
    "encoder": calibrate_encoder, "imu": calibrate_imu, "esc": calibrate_esc,
    "lagging": calibrate_esc,
    "steering": lambda car, workshop: calibrate_steering(car, dry_run=True),
    "throttle": calibrate_throttle,
    "circle": lambda car, workshop: calibrate_throttle(car, workshop, room=0.0),
    "latency": calibrate_latency,
    "mocap": lambda car, workshop: calibrate_mocap(car),
    "lidar": lambda car, workshop: calibrate_lidar(car, chart=room_map(car.url))}
LATE = ("latency", "lagging")
"""Verbs whose car has a delay and a lag of its motor."""
BENT = ("mocap", "lidar", "all")
"""Verbs whose car has a rear tyre that bends: the circles of the two are what shows it."""


def room_map(url: str) -> Map:
    """Of the room of a simulated car, as who owns one has it."""
    return map_of_lines(np.array(reveal_url(Url.parse(url))["room"]["lines"]))


def url_of(seed: int, mocap: bool = False, late: bool = True, lidar: bool = False,
           bent: bool = False) -> str:
    """The hidden car of a seed; ``late``: with a delay and a lag of its motor, ``bent``: with a
    rear tyre that is no straight line."""
    url = f"sim://?seed={seed}&nano=mock&mocap={int(mocap)}&lidar={int(lidar)}"
    effects = []
    if late:
        rng = np.random.default_rng([seed, 500])
        delay, lag = rng.uniform(0.0, 0.04), rng.uniform(0.015, 0.1)
        effects += [f"throttle_delay:{delay:.4f}", f"throttle_lag:{lag:.4f}"]
    if bent:
        effects.append(f"rear_saturation:{rear_bend(seed):.4f}")
    return f"{url}&effect={','.join(effects)}" if effects else url


def true_sensors(url: str) -> dict[str, float]:
    """The truth of ``sim --reveal`` with the effects of the URL on top.

    Without pulses the motor pulls on for the ESC's time, the delay, and what the lag leaves of a
    pull: y e^(-t/T) until it falls to the dead band g, over y - g, is T (1 - g / (y - g) ln(y/g)).
    """
    found = reveal_url(Url.parse(url))
    sensors = dict(found["sensors"])
    for effect in found["effects"]:
        if effect["name"] == "rear_saturation":  # no sensor shows it
            continue
        size = next(iter(effect["parameters"].values()))["value"]
        name = {"throttle_delay": "latency.pulse_to_wheel",
                "throttle_lag": "latency.pulse_to_wheel_lag"}[effect["name"]]
        sensors[name] += size
        beyond = esc.PULSE_LEVELS[esc.BRAKE_LEVEL] / sensors["throttle.deadband_forward_us"]
        share = 1.0 if effect["name"] == "throttle_delay" else 1.0 - np.log1p(beyond) / beyond
        sensors["throttle.signal_loss"] += share * size
    return sensors


Errors = dict[str, list[tuple[float, float]]]
"""(error, standard error) of each number of a quantity, by its name."""


def errors(verb: str, seed: int) -> Errors:
    """What one procedure found on one hidden car, "all": every one, each by what came before."""
    url = url_of(seed, verb in ("mocap", "all"), verb in LATE, verb in ("lidar", "all"),
                 verb in BENT)
    with tempfile.TemporaryDirectory() as folder:
        if verb == "all":
            return all_errors(seed, url, folder)
        if verb == "latency":
            with Car.open(url, cars=folder) as car:
                calibrate_steering(car)
        backend = open_backend(url)
        with filtered_gyro(seed), Car.over(backend, cars=folder) as car:
            return errors_in(seed, url, car.files, VERBS[verb](car, backend.workshop))


def worst(rows: Errors) -> dict[str, float]:
    """The largest error of each quantity by its standard error."""
    return {name: max(abs(e) / std for e, std in pairs) for name, pairs in rows.items()}


def all_errors(seed: int, url: str, folder: str) -> Errors:
    """As ``dart-hal calibrate all`` in a folder of cars."""
    with Car.open(url, cars=folder) as car:
        steps = order.make_steps(car.files, poses=True, chart=room_map(url))
    rows: Errors = {}
    for step in steps:
        backend = open_backend(url)
        with filtered_gyro(seed), Car.over(backend, cars=folder) as car:
            found = step.run(car, backend.workshop, silent, agree)
            files = car.files
        write(files, found)
        rows |= errors_in(seed, url, files, found)
    return rows


def errors_in(seed: int, url: str, files: CarFiles, found: Measured | SteeringResult) -> Errors:
    """Of what one procedure found."""
    return (map_errors(url, files, found) if isinstance(found, SteeringResult)
            else errors_of(seed, url, found))


def errors_of(seed: int, url: str, found: Measured) -> Errors:
    """Of every number that stands in ``found``."""
    true, second = true_sensors(url), host_second(seed)
    rows = {}
    for name, q in found.quantities.items():
        value, std = np.atleast_1d(q.value), np.broadcast_to(q.std, np.shape(q.value) or 1)
        off = off_by(value, in_seconds(name, np.atleast_1d(true[name]), second))
        rows[name] = [(float(e), float(s)) for e, s in zip(off, std, strict=True)]
    return rows | drive_errors(seed, found)


def off_by(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Errors of a ring, whose first interval may be any, or of one number."""
    every = [found - np.roll(true, k) for k in range(len(found))]
    return min(every, key=lambda e: float(e @ e))


def map_errors(url: str, files: CarFiles, found: SteeringResult) -> Errors:
    """Backlash [rad], and the map's points [rad] at their pulses."""
    shown, steering = reveal_url(Url.parse(url)), files.config.steering
    command = (found.pulse_us - steering.center_us) / steering.span_us
    true = np.interp(command, shown["steering"]["command"], shown["steering"]["angle_rad"])
    rows = {"steering.map": [(float(e), float(s)) for e, s in
                             zip(found.angle - true, found.angle_std, strict=True)]}
    if found.backlash is not None:
        rows["steering.backlash"] = [(found.backlash.value - shown["sensors"]["steering.backlash"],
                                      found.backlash.std)]
    return rows


def drive_errors(seed: int, found: Measured) -> Errors:
    """(error, standard error) [us] of each point of a drive table, together.

    The simulator's speeds and pulses count in the host's seconds.
    """
    table = found.others.get("throttle.drive")
    if not isinstance(table, DriveTable):
        return {}
    rows, second = zip(table.speed, table.pulse_us, table.std_us, strict=True), host_second(seed)
    return {"throttle.drive": [(pulse - holding_pulse(seed, speed * second) * second, std)
                               for speed, pulse, std in rows]}


def holding_pulse(seed: int, speed: float) -> float:
    """The pulse [us] that holds a speed [m/s] straight ahead on a hidden car."""
    shown = reveal(seed)
    motor, friction = ({key: q["value"] for key, q in shown["vehicle"][group].items()}
                       for group in ("motor", "friction"))
    drive = make_drive(Motor(**motor), Friction(**friction))
    throttle = brentq(lambda tau: drive(tau, speed), 0.1, 1.0)
    sensors = shown["sensors"]
    return float(sensors["throttle.neutral_us"] + sensors["throttle.saturation_us"] * throttle)
