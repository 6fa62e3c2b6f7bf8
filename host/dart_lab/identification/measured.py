"""Model of a car that was calibrated and not yet identified.

It is the paper's model with the values and standard errors of this car's car.toml and
calibration.toml: size, mass, steering map, play and slew of the steering, delays, dead band of the
ESC. Values that were not measured are the paper's, without a standard error. A fit that starts
here does not have to estimate from tyre slip what a procedure has measured directly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np

from dart_hal.calibration import curves
from dart_hal.calibration.samples import Samples
from dart_hal.calibration.steering_map import ANGLE_NOISE, fit_map
from dart_hal.car import Car
from dart_hal.control.measured import vehicle_for
from dart_hal.core.config import CarFiles, ModelFile, Quantity, plain
from dart_hal.core.config.calibration import LatencyCalibration, SteeringCalibration, SteeringTable
from dart_hal.core.config.car import Geometry
from dart_hal.core.config.model import Parameters
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.types import FloatArray
from dart_hal.devices.actuation.steering_map import steering_map
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Body, Steering, Vehicle
from dart_hal.vehicle.sets import PAPER

# Name of this model for verbs that take the name of one.
MEASURED = "measured"
# [us] Dithering holds the mean pulse to a tenth of a count of the PCA9685, 20 ms / 4096.
PULSE_STD_US = 0.5
Errors = dict[str, float]
"""Standard errors by "section.key"."""


def named_model(name: str | Path, paths: Sequence[str | Path]) -> tuple[ModelFile, Vehicle]:
    """Find a model by name; "measured": the model of the car of the runs ``paths``.

    The newest calibration of all runs counts. Raises as ``find_model``; RecordingError for a file
    that is not a run; UsageError if no run has a calibration, or they are of several cars.
    """
    if str(name) != MEASURED:
        return find_model(name)
    runs = _runs_in(paths)
    known = [files for files in map(_files_of, runs) if files.calibration is not None]
    if not known:
        raise UsageError("no calibration of this car was found",
                         found=f"{len(runs)} run(s) (*.mcap), none with a calibration",
                         expected="a run that was recorded after dart-hal calibrate",
                         remedy="dart-hal calibrate all, then drive and record; or start from "
                         "paper")
    cars = sorted({files.config.name for files in known})
    if len(cars) > 1:
        raise UsageError("these runs are of several cars, each with its own calibration",
                         found=", ".join(cars), expected="runs of one car",
                         remedy=f"leave out all but those of {cars[0]}")
    model = measured_model(max(known, key=_calibration_time))
    return model, vehicle_of(model)


def default_model(paths: Sequence[str | Path]) -> str:
    """Choose the model of verbs that name none: "measured" where a run has a calibration.

    "paper" for other recordings, and for runs of several cars. Files that are no runs are handled
    by their reader.
    """
    cars = set()
    for run in _runs_in(paths):
        with suppress(DartHalError, OSError):
            files = _files_of(run)
            if files.calibration is not None:
                cars.add(files.config.name)
    return MEASURED if len(cars) == 1 else PAPER.name


def _runs_in(paths: Sequence[str | Path]) -> list[Path]:
    """List the runs (*.mcap) among the files and folders that exist."""
    return [run for path in map(Path, paths)
            for run in (sorted(path.rglob("*.mcap")) if path.is_dir() else [path])
            if run.suffix == ".mcap" and run.is_file()]


def measured_model(files: CarFiles) -> ModelFile:
    """Return the paper's model with all measured values of ``files``."""
    p = replace(vehicle_for(replace(files, model=None)), name=files.config.name,
                body=_body(files.config.geometry))
    errors: Errors = {}
    calibration = files.calibration
    if calibration is not None:
        p = _insert_steering(p, calibration.steering, files, errors)
        p = _insert_delays(p, calibration.latency, errors)
        band = calibration.throttle.deadband_forward_us
        if band is not None:
            errors["motor.g"] = math.hypot(band.std, PULSE_STD_US) / files.config.throttle.span_us
    return _insert_errors(model_of(p), errors)


def _files_of(run: Path) -> CarFiles:
    stat = run.stat()
    return _files_in(run, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=64)
def _files_in(run: Path, mtime: int, size: int) -> CarFiles:
    """Read the car's files in a run, once; mtime, size: of the run's file, as cache keys."""
    with Car.open(f"replay://{run}") as car:
        return car.files


def _calibration_time(files: CarFiles) -> str:
    """Return when the calibration was written, as text that sorts by time."""
    return str(files.calibration.provenance.get("when", "")) if files.calibration else ""


def _body(size: Geometry) -> Body:
    """Return the body; without a yaw inertia in car.toml, the paper's scaled by the mass."""
    paper = PAPER.body
    return replace(paper, wheelbase=size.wheelbase, l_f=size.l_f, l_r=size.l_r, mass=size.mass,
                   yaw_inertia=size.yaw_inertia or paper.yaw_inertia * size.mass / paper.mass)


def _insert_steering(p: Vehicle, measured: SteeringCalibration, files: CarFiles, errors: Errors
                     ) -> Vehicle:
    """Insert map, slew and play of the steering; add their standard errors to ``errors``."""
    if measured.map is not None:
        command_of = steering_map(files.config, measured.map).command
        command = np.array([command_of(pulse) for pulse in measured.map.pulse_us])
        steering, std = paper_form(command, measured.map)
        p = replace(p, steering=steering)
        errors |= {f"steering.{key}": s
                   for key, s in zip(asdict(steering), std.tolist(), strict=True)}
    slew = measured.slew_us_s
    play = measured.backlash
    if slew is not None:
        per_unit = files.config.steering.span_us / slew.value
        p = apply(p, "steering_rate_limit", k=per_unit)
        errors["steering_rate_limit.k"] = per_unit * slew.std / slew.value
    if play is not None and play.value > 0.0:
        p = apply(p, "steering_backlash", k=play.value)
        errors["steering_backlash.k"] = play.std
    return p


def paper_form(command: FloatArray, table: SteeringTable) -> tuple[Steering, FloatArray]:
    """Fit the paper's form to a steering table; return it with the standard errors (5,).

    command (n,): of the points of the table. The covariance is the sum of two: of the misfit of
    the form, and of the errors of the table, which are taken as independent.
    """
    angle = np.array(table.angle_rad)
    std = np.array(table.std_rad)
    zeros = np.zeros(len(angle))
    form = fit_map(Samples(command, angle, zeros, zeros, (ANGLE_NOISE / std)**2,
                           np.arange(len(angle))))
    slopes = curves.steering(form.parameters, command)[1] / std[:, None]
    covariance = form.covariance + np.linalg.pinv(slopes.T @ slopes)
    return Steering(**form.as_dict()), np.asarray(np.sqrt(np.diag(covariance)))


def _insert_delays(p: Vehicle, measured: LatencyCalibration, errors: Errors) -> Vehicle:
    """Insert delays and lags from a command to the wheels and to the force of the motor."""
    found = {}
    pulse = measured.command_to_pulse
    for name, delay, lag in (
            ("steering", measured.pulse_to_yaw, measured.pulse_to_yaw_lag),
            ("throttle", measured.pulse_to_wheel, measured.pulse_to_wheel_lag)):
        if pulse is not None and delay is not None:
            found[f"{name}_s"] = max(pulse.value + delay.value, 0.0)
            errors[f"delay.{name}_s"] = math.hypot(pulse.std, delay.std)
        if lag is not None:
            found[f"{name}_lag_s"] = max(lag.value, 0.0)
            errors[f"delay.{name}_lag_s"] = lag.std
    return replace(p, delay=replace(p.delay, **found))


def _insert_errors(model: ModelFile, errors: Errors) -> ModelFile:
    """Insert the standard errors of the measured values into a model file."""
    def entries(section: str, table: Parameters) -> Parameters:
        measured = {key: Quantity(plain(value), errors[f"{section}.{key}"], "calibration")
                    for key, value in table.items() if f"{section}.{key}" in errors}
        return {**table, **measured}

    sections: Mapping[str, Parameters] = {
        name: entries(name, getattr(model, name)) for name in ("motor", "steering", "delay")}
    return msgspec.structs.replace(
        model, **sections, provenance={"base": PAPER.name, "method": "calibration"},
        effects=tuple(msgspec.structs.replace(e, parameters=entries(e.name, e.parameters))
                      for e in model.effects))
