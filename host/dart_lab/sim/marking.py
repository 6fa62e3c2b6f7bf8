"""Mark what was measured on a simulated car against its truth, for a lecturer.

Only quantities with a true counterpart are marked. An effect of the car that acts on a sensor or an
actuator changes what a procedure measures there, so these quantities are left out by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from statistics import NormalDist
from typing import Any

import numpy as np

from dart_hal.calibration.measured import QUANTITY_UNITS
from dart_hal.core.config import (
    Calibration,
    CarFiles,
    DriveTable,
    ModelFile,
    Quantities,
    Quantity,
    parse_car,
)
from dart_hal.core.config.folders import Folders
from dart_hal.core.config.model import MODEL_PARAMETERS
from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.core.types import INTERVAL_90, FloatArray
from dart_hal.core.url import Url
from dart_hal.vehicle import Motor, flat, make_steering
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import unit
from dart_hal.vehicle.motor import make_drive
from dart_lab.sim.backend import lidar_in_room, mocap_in_room
from dart_lab.sim.car_file import car_toml
from dart_lab.sim.drawn import ResolvedCar, resolve_car
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.sealed import check_may_reveal
from dart_lab.sim.true_car import TILT_EFFECTS
from dart_lab.sim.truth import sensor_truth

# Share of the intervals that hold the truth, if the standard errors are right.
INTERVAL_COVERAGE = 0.9
# Units of quantities that no verb of its own measures.
UNIT_BY_QUANTITY = {**QUANTITY_UNITS, "steering.backlash": "rad"}
# Bisections of a throttle between 0 and 1: to the last bit.
BISECTIONS = 60
# Parameters of a model that are identified in turns.
DRIVEN_TURNS = ("model.steering.", "model.delay.", "model.tyres.", "model.body.yaw_inertia")
# Names of calibration.toml and of a model that an effect on a signal of the car changes.
CHANGED_BY_SIGNAL: Mapping[str, tuple[str, ...]] = {
    "throttle": ("throttle.", "latency.pulse_to_wheel", "model.motor.", "model.friction."),
    "steering": ("steering.", "latency.pulse_to_yaw", *DRIVEN_TURNS),
    "angle": ("steering.", "latency.pulse_to_yaw", *DRIVEN_TURNS),
    "wheel": ("encoder.", "throttle.", "steering.", "imu.gyro_scale", "latency.", "mocap.",
              "lidar.", "model."),
    "gyro": ("imu.", "steering.", "latency.pulse_to_yaw", "mocap.", "lidar.", *DRIVEN_TURNS),
    "accel": ("imu.",),
}
# Those that any other force on the car changes: they are measured while it drives.
CHANGED_BY_FORCE = ("throttle.", "steering.", "latency.pulse_to", "imu.mount_yaw", "model.")


@dataclass(frozen=True, slots=True)
class Mark:
    """One line of a marking sheet.

    measured, low, high: None for an effect that was not found; true: None for one that the car does
    not have. ``inside``: the truth is in the interval [low, high].
    """

    group: str
    name: str
    unit: str
    true: float | None
    measured: float | None
    low: float | None
    high: float | None

    @property
    def inside(self) -> bool:
        if self.true is None or self.low is None or self.high is None:
            return False
        return self.low <= self.true <= self.high


@dataclass(frozen=True, slots=True)
class MarkingSheet:
    """Marks of one car, and the measured quantities that effects of the car change.

    causes: names of the causes in its model, None without a model.
    """

    car: str
    marks: tuple[Mark, ...]
    unmarked: tuple[str, ...]
    causes: tuple[str, ...] | None = None

    @property
    def inside(self) -> int:
        return sum(mark.inside for mark in self.marks)

    def to_json(self) -> dict[str, Any]:
        """The JSON object of ``sim --reveal --against``; plain types."""
        return {"car": self.car, "coverage": INTERVAL_COVERAGE, "inside": self.inside,
                "count": len(self.marks), "unmarked": list(self.unmarked),
                "marks": [{**asdict(mark), "inside": mark.inside} for mark in self.marks]}


def mark_car(url: Url, cars: Folders, secret: bytes | None = None) -> MarkingSheet:
    """Mark the files of a simulated car in a folder of cars. Raises UsageError, ConfigError.

    secret: that of the class of a sealed car, which is refused without it.
    """
    check_may_reveal(url, secret)
    resolved = resolve_car(url)
    files = parse_car(car_toml(resolved.base, resolved.body), url.text, cars)
    calibration = files.calibration
    if calibration is None and files.model is None:
        raise UsageError(f"nothing was measured on {files.config.name}", found=str(files.folder),
                         expected="its calibration.toml or model.toml",
                         remedy=f"dart-hal calibrate all --url '{url.text}' --cars FOLDER")
    marks: list[Mark] = []
    unmarked: list[str] = []
    measured: list[Mark] = []
    if calibration is not None:
        measured += _mark_calibration(url, resolved, files, calibration)
    if files.model is not None:
        measured += _mark_parameters(resolved, files, files.model)
    changed = _changed_names(resolved)
    for mark in measured:
        if f"{mark.group}.{mark.name}".startswith(changed):
            unmarked.append(f"{mark.group}.{mark.name}")
        else:
            marks.append(mark)
    if files.model is not None:
        marks += _mark_effects(resolved, files.model)
    causes = _causes(files.model) if files.model is not None else None
    return MarkingSheet(files.config.name, tuple(marks), tuple(unmarked), causes)


def _changed_names(resolved: ResolvedCar) -> tuple[str, ...]:
    """Return the beginnings of the names of quantities that effects of the car change."""
    names: list[str] = []
    for active in resolved.true.vehicle.effects:
        names += CHANGED_BY_FORCE if active.effect.force else ()
        for signal in active.effect.signals:
            names += CHANGED_BY_SIGNAL.get(signal, ())
    tilted = any(a.name in TILT_EFFECTS for a in resolved.effects)
    names += ["imu.", "steering.", "latency.pulse_to_yaw"] if tilted else []
    # An effect that is a change of parameters changes those of the model.
    healthy = flat.values(resolved.base.vehicle)
    names += [f"model.{name}" for name, value in flat.values(resolved.true.vehicle).items()
              if name in healthy and value != healthy[name]]
    if (resolved.true.servo.delay, resolved.true.servo.lag) != (
            resolved.base.servo.delay, resolved.base.servo.lag):
        names += ["model.delay."]
    # Without pulses, a motor with delay or lag pulls longer than its speed controller.
    esc = resolved.true.esc
    names += ["throttle.signal_loss"] if esc.delay > 0.0 or esc.lag > 0.0 else []
    return tuple(names)


def _mark_calibration(url: Url, resolved: ResolvedCar, files: CarFiles, calibration: Calibration
                      ) -> Iterator[Mark]:
    # 1. Single quantities, and the ring of the encoder.
    truth = _true_sensors(url, resolved)
    for name, quantity in calibration.quantities().items():
        group, _, key = name.partition(".")
        true = truth.get(name)
        if isinstance(quantity, Quantity) and isinstance(true, float):
            yield _mark(group, key, UNIT_BY_QUANTITY[name], true, quantity)
        elif (isinstance(quantity, Quantities) and isinstance(true, list)
              and len(true) == len(quantity.value)):
            yield _mark_ring(true, quantity)
    # 2. The steering map, at the commands of its pulses.
    table = calibration.steering.map
    if table is not None:
        steering = files.config.steering
        curve = make_steering(resolved.true.servo.curve, np)
        command = (np.array(table.pulse_us) - steering.center_us) / steering.span_us
        yield _mark_worst("steering", "map", "rad", curve(command), table.angle_rad, table.std_rad,
                          [f"at {pulse:.0f} us" for pulse in table.pulse_us])
    # 3. The pulses of constant speeds.
    if calibration.throttle.drive is not None:
        yield _mark_drive(resolved.true, calibration.throttle.drive)


def _true_sensors(url: Url, resolved: ResolvedCar) -> dict[str, Any]:
    """Return the true values by their names in calibration.toml, with the effects of the car."""
    truth = sensor_truth(resolved.true)
    mocap = mocap_in_room(url, resolved.base.seed)
    if mocap is not None:
        truth |= {"mocap.marker_x": mocap.lx, "mocap.marker_y": mocap.ly,
                  "mocap.marker_yaw": mocap.theta, "mocap.latency": mocap.latency}
    lidar = lidar_in_room(url, resolved.base.seed)
    if lidar is not None:
        truth |= {"lidar.mount_x": lidar[0].x, "lidar.mount_y": lidar[0].y,
                  "lidar.mount_yaw": lidar[0].yaw, "lidar.scale": lidar[0].scale}
    return truth


def _mark(group: str, key: str, unit: str, true: float, quantity: Quantity) -> Mark:
    half = INTERVAL_90 * quantity.std
    return Mark(group, key, unit, true, quantity.value, quantity.value - half,
                quantity.value + half)


def _mark_worst(group: str, key: str, unit: str, true: Sequence[float] | FloatArray,
                measured: Sequence[float], std: Sequence[float], points: Sequence[str]) -> Mark:
    """Mark several values of one quantity by the one with the largest error by its standard error.

    Its interval is as wide as all n need to hold n true values with a probability of 90 %:
    each holds its own with .9^(1/n), the bound of Sidak.
    """
    n = len(measured)
    scale = NormalDist().inv_cdf(0.5 * (1.0 + INTERVAL_COVERAGE ** (1.0 / n)))
    errors = np.abs(np.array(measured) - np.array(true)) / np.maximum(std, 1e-300)
    k = int(np.argmax(errors))
    half = scale * std[k]
    name = f"{key}, worst of {n} ({points[k]})"
    return Mark(group, name, unit, float(true[k]), measured[k], measured[k] - half,
                measured[k] + half)


def _mark_ring(true: Sequence[float], quantity: Quantities) -> Mark:
    """Mark the intervals of an encoder ring, whose first interval may be any of them."""
    n = len(true)
    turned = [list(np.roll(true, k)) for k in range(n)]
    best = min(turned, key=lambda t: float(np.sum((np.array(quantity.value) - t) ** 2)))
    std = np.broadcast_to(quantity.std, n)
    return _mark_worst("encoder", "ring", "-", best, quantity.value, [float(s) for s in std],
                       [f"interval {k + 1}" for k in range(n)])


def _mark_drive(car: HiddenCar, table: DriveTable) -> Mark:
    """Mark the pulses that hold constant speeds straight ahead."""
    drive = make_drive(car.vehicle.motor, car.vehicle.friction)
    esc = car.esc
    true = [esc.neutral_us + esc.saturation_us * _find_zero(partial(_force_at, drive, v))
            for v in table.speed]
    return _mark_worst("throttle", "drive", "us", true, table.pulse_us, table.std_us,
                       [f"at {v:.2f} m/s" for v in table.speed])


def _force_at(drive: Callable[..., float], speed: float, throttle: float) -> float:
    return drive(throttle, speed)


def _mark_parameters(resolved: ResolvedCar, files: CarFiles, model: ModelFile) -> Iterator[Mark]:
    """Mark the parameters of a model that have a standard error and a true counterpart."""
    truth = _true_parameters(resolved, files)
    for section in MODEL_PARAMETERS:
        for key, entry in getattr(model, section).items():
            name = f"{section}.{key}"
            if not isinstance(entry, Quantity) or name not in truth:
                continue
            # Nothing in a model states its neutral: the nearer truth counts.
            true = min(truth[name], key=lambda value: abs(value - entry.value))
            yield _mark("model", name, unit(resolved.true.vehicle, name), true, entry)


def _true_parameters(resolved: ResolvedCar, files: CarFiles) -> dict[str, tuple[float, ...]]:
    """Return the true parameters as a fit sees them, by name, with all values that may be meant.

    A lag has no true counterpart: the limited rate of the servo is fitted as one.
    """
    car = resolved.true
    truth: dict[str, tuple[float, ...]] = {
        name: (float(value),) for name, value in flat.values(car.vehicle).items()
        if name.partition(".")[0] in ("body", "friction", "motor", "steering", "tyres")}
    motor = car.vehicle.motor
    if isinstance(motor, Motor):
        # Throttle is a pulse of car.toml: of another neutral and scale than those of the ESC.
        throttle = files.config.throttle
        scale = throttle.span_us / car.esc.saturation_us
        truth |= {"motor.d": (motor.d * scale,), "motor.e": (motor.e * scale,),
                  "motor.g": tuple(motor.g / scale + (neutral - car.esc.neutral_us)
                                   / throttle.span_us
                                   for neutral in (files.neutral_us, throttle.neutral_us))}
    # A command waits for a PWM frame.
    truth["delay.steering_s"] = (car.servo.delay
                                 + sensor_truth(car)["latency.command_to_pulse"],)
    return truth


def _find_zero(force: Callable[[float], float]) -> float:
    """Return the throttle 0..1 at which a force [N] that rises with it is zero."""
    low = 0.0
    high = 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if force(middle) > 0.0:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _causes(model: ModelFile) -> tuple[str, ...]:
    """Return the effects of a model that are causes.

    A diagnosis names its causes in the provenance. Its other effects, such as the mounting of an
    IMU, are parameters of the fit without a true counterpart. Raises ConfigError.
    """
    causes = model.provenance.get("causes", [effect.name for effect in model.effects])
    if not (isinstance(causes, list) and all(isinstance(name, str) for name in causes)):
        raise ConfigError("provenance.causes of model.toml names no effects", found=repr(causes),
                          expected='a list of names, such as ["grip"]')
    return tuple(causes)


def _mark_effects(resolved: ResolvedCar, model: ModelFile) -> Iterator[Mark]:
    """Mark the effects of a model: those of the car, and causes that the car does not have."""
    found = {effect.name: effect.parameters for effect in model.effects}
    causes = _causes(model)
    # Effects of the car, found or not.
    for active in resolved.effects:
        entries = found.pop(active.name, {})
        for parameter, true in zip(active.effect.parameters, active.values, strict=True):
            entry = entries.get(parameter.name)
            yield _mark_effect(active.name, parameter.name, parameter.unit, true, entry)
    # What remains is not an effect of the car.
    for name, entries in found.items():
        if name not in causes:
            continue
        known = catalogue().get(name)
        units = {p.name: p.unit for p in known.parameters} if known else {}
        for key, entry in entries.items():
            yield _mark_effect(name, key, units.get(key, "-"), None, entry)


def _mark_effect(name: str, key: str, unit: str, true: float | None,
                 entry: float | Quantity | None) -> Mark:
    if entry is None:
        return Mark("effect", f"{name}.{key}", unit, true, None, None, None)
    quantity = entry if isinstance(entry, Quantity) else Quantity(float(entry), 0.0)
    mark = _mark("effect", f"{name}.{key}", unit, 0.0, quantity)
    return replace(mark, true=true)


def format_marks(sheet: MarkingSheet) -> Iterable[str]:
    """Yield the lines of a sheet: one for each mark, grouped, and the count."""
    marks = sorted(sheet.marks, key=lambda mark: mark.group)  # stable: the order of each group
    rows = [(mark.name, *_format_mark(mark)) for mark in marks]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    group = ""
    for mark, row in zip(marks, rows, strict=True):
        if mark.group != group:
            group = mark.group
            yield group
        cells = (f"{cell:{width}}" for cell, width in zip(row, widths, strict=True))
        yield ("  " + "  ".join(cells)).rstrip()
    if sheet.unmarked:
        yield ("not marked, because an effect of the car acts on them: "
               + ", ".join(sheet.unmarked))
    share = f"{100 * INTERVAL_COVERAGE:.0f} %"
    yield (f"{sheet.car}: {sheet.inside} of {len(marks)} truths inside their {share} intervals"
           f" ({share} is what right standard errors give)")


def _format_mark(mark: Mark) -> tuple[str, str, str, str]:
    """Return the cells of a line: true value, measured value, interval, verdict."""
    unit = "" if mark.unit == "-" else f" {mark.unit}"
    if mark.measured is None or mark.low is None or mark.high is None:
        return f"true {_format(mark.true, 3)}{unit}", "not found", "", "OUTSIDE"
    # Three digits, and as many more as show two digits of the interval's half-width.
    half = 0.5 * (mark.high - mark.low)
    largest = max(abs(mark.measured), abs(mark.true or 0.0))
    digits = 3
    if 0.0 < half < largest:
        digits = max(3, 2 + math.floor(math.log10(largest)) - math.floor(math.log10(half)))
    low, measured, high = (_format(x, digits) for x in (mark.low, mark.measured, mark.high))
    true = "not there" if mark.true is None else f"true {_format(mark.true, digits)}{unit}"
    return (true, f"measured {measured}{unit}", f"{low} to {high}{unit}",
            "inside" if mark.inside else "OUTSIDE")


def _format(value: float | None, digits: int) -> str:
    """Format a number with so many significant digits, trailing zeros kept, no exponent above 1."""
    if value is None:
        return "-"
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}"
