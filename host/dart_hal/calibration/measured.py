"""Measured quantities, and the write-back into calibration.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from typing import Any, TypeVar

import msgspec

from dart_hal.core.config import (
    Calibration,
    CarFiles,
    DriveTable,
    Quantity,
    bind_board,
    calibration_in,
    save_calibration,
)
from dart_hal.core.config.quantity import Quantities
from dart_hal.core.rounding import format_interval
from dart_hal.core.types import INTERVAL_90, FloatArray

from .result import Result, Summary, indent, number

R = TypeVar("R", bound=Result)

# Units of the quantities of the built-in procedures.
QUANTITY_UNITS = {
    "pwm.oscillator_hz": "Hz", "encoder.metres_per_edge": "m", "encoder.ring": "-",
    "imu.gyro_bias": "rad/s", "imu.gyro_scale": "-", "imu.mount_yaw": "rad",
    "imu.mount_pitch": "rad", "imu.mount_roll": "rad", "throttle.neutral_us": "us",
    "throttle.deadband_forward_us": "us", "throttle.deadband_reverse_us": "us",
    "throttle.saturation_us": "us", "throttle.reverse_rest": "s", "throttle.signal_loss": "s",
    "throttle.brake": "m/s2",
    "latency.command_to_pulse": "s", "latency.pulse_to_wheel": "s",
    "latency.pulse_to_wheel_lag": "s", "latency.pulse_to_yaw": "s",
    "latency.pulse_to_yaw_lag": "s", "latency.sensor_to_host": "s", "steering.slew_us_s": "us/s",
    "mocap.marker_x": "m", "mocap.marker_y": "m", "mocap.marker_yaw": "rad", "mocap.latency": "s",
    "lidar.mount_x": "m", "lidar.mount_y": "m", "lidar.mount_yaw": "rad", "lidar.scale": "-",
}


@dataclass(frozen=True, slots=True)
class FitGraph:
    """Measurements with the fit and its 90 % interval, for a page.

    x, y (n,): points. fit_x, fit_y, half (k,): curve and half-width of its interval.
    """

    title: str
    x_label: str
    y_label: str
    x: FloatArray
    y: FloatArray
    fit_x: FloatArray
    fit_y: FloatArray
    half: FloatArray
    points_name: str = "measured"
    curve_name: str = "fit, 90 % interval"


@dataclass(frozen=True, slots=True)
class Measured:
    """Result of one procedure on one car; not written while ``written`` is None.

    verb: as in ``calibrate VERB``. quantities: by their names in calibration.toml. residual: a
    sentence on how well the measurements agree. duration [s] of car time. others: values that are
    not quantities, by their names in calibration.toml. absent: names that were looked for and are
    not there: older values are removed. graph: data and fit, for the page.
    """

    car: str
    source: str
    verb: str
    quantities: Mapping[str, Quantity | Quantities]
    residual: str
    duration: float
    notes: tuple[str, ...] = ()
    written: str | None = None
    others: Mapping[str, str | DriveTable] = field(default_factory=dict)
    absent: tuple[str, ...] = ()
    graph: FitGraph | None = field(default=None, repr=False, compare=False)

    @property
    def unwritten(self) -> str:
        """Empty: it can always be written."""
        return ""

    def to_json(self) -> dict[str, Any]:
        """The JSON object of ``calibrate VERB``; plain types."""
        return {
            "car": self.car, "source": self.source,
            "quantities": {name: {"value": _plain(q.value), "std": _plain(q.std),
                                  "unit": QUANTITY_UNITS[name]}
                           for name, q in self.quantities.items()},
            "others": {name: msgspec.to_builtins(v) for name, v in self.others.items()},
            "residual": self.residual, "duration_s": number(self.duration),
            "written": self.written, "notes": list(self.notes),
        }

    def summary(self) -> Summary:
        """Each quantity with standard error and 90 % interval, the residual, the notes."""
        rows: list[tuple[str, ...]] = []
        for name, q in self.quantities.items():
            if isinstance(q, Quantity):
                unit = unit_of(name)
                value, std, low_end, high_end = format_interval(q.value, q.std, INTERVAL_90 * q.std)
                rows.append((name, f"{value}{unit}", f"{std}{unit}",
                             f"{low_end} to {high_end}{unit}"))
            else:
                low, high = min(q.value), max(q.value)
                rows.append((name, f"{len(q.value)} from {low:.3g} to {high:.3g}",
                             "per value (--json)", ""))
        for name, other in self.others.items():
            if isinstance(other, DriveTable):
                points = zip(other.speed, other.pulse_us, other.std_us, strict=True)
                for speed, pulse, pulse_std in points:
                    value, std, low_end, high_end = format_interval(pulse, pulse_std,
                                                                    INTERVAL_90 * pulse_std)
                    rows.append((f"{name} at {speed:.2f} m/s", f"{value} us", f"{std} us",
                                 f"{low_end} to {high_end} us"))
            else:
                rows.append((name, other.replace("_", " "), "", ""))
        return Summary(f"{self.verb} of {self.car}",
                       ("quantity", "value", "one sigma", "90 % interval"), tuple(rows),
                       (self.residual + (f", {self.duration:.0f} s of the car's time"
                                         if self.duration else ""),
                        *indent(self.notes)))

    def put_into(self, calibration: Calibration) -> Calibration:
        """Add the rounded quantities and the other values, and remove those that are absent."""
        new = calibration.with_quantities({name: _round(q) for name, q in self.quantities.items()})
        for name, value in (*self.others.items(), *dict.fromkeys(self.absent).items()):
            # A name is "table.key".
            table, _, key = name.partition(".")
            inner = msgspec.structs.replace(getattr(new, table), **{key: value})
            new = msgspec.structs.replace(new, **{table: inner})
        return new

    def provenance(self) -> dict[str, Any]:
        """Source, residual and driving time [s]."""
        return {"source": self.source, "residual": self.residual,
                "duration_s": round(self.duration, 2)}


def unit_of(name: str) -> str:
    """Return the unit of a quantity with a space before it; empty for a number without unit."""
    unit = QUANTITY_UNITS.get(name, "-")
    return "" if unit == "-" else f" {unit}"


def write(files: CarFiles, result: R) -> R:
    """Write a result of any procedure, with its provenance, to the car's calibration.toml.

    The previous file is kept in history/; values of other procedures stay.
    Raises CalibrationFailed, ConfigError, OSError.
    """
    old = calibration_in(files.folder, files.config.name, files.config)
    new = result.put_into(old)
    now = datetime.now(timezone.utc).replace(microsecond=0)
    provenance = {**old.provenance, "when": now,
                  result.verb: {"when": now, **result.provenance()}}
    new = bind_board(msgspec.structs.replace(new, provenance=provenance), files)
    return replace(result, written=str(save_calibration(new, files.folder, files.config)))


def list_outdated(files: CarFiles, changed: bool, measured_with: str, *dependents: str
                  ) -> tuple[str, ...]:
    """Return a caution if a value has ``changed`` on which other results of the car depend.

    measured_with: the former value, with its unit. dependents: procedures that use it; one that
    was not run on this car is left out.
    """
    cal = files.calibration
    names = [name for name in dependents if cal is not None and name in cal.provenance]
    if not changed or not names:
        return ()
    return (f"caution: measured with {measured_with}: {', '.join(names)}; run dart-hal calibrate "
            f"{' and '.join(names)} again",)


def _round(q: Quantity | Quantities) -> Quantity | Quantities:
    """Round to a hundredth of the standard error."""
    if isinstance(q, Quantities) or q.std <= 0.0:
        return q
    digits = 2 - math.floor(math.log10(q.std))
    return Quantity(round(float(q.value), digits), round(float(q.std), digits), q.method)


def _plain(value: float | tuple[float, ...]) -> Any:
    return [number(v) for v in value] if isinstance(value, tuple) else number(value)
