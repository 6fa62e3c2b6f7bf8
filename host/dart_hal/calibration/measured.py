"""Quantities that a procedure measured: shown, as JSON, and written to calibration.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from typing import Any

import msgspec

from dart_hal.core.config import (
    CarFiles,
    DriveTable,
    Quantity,
    bind_board,
    calibration_in,
    save_calibration,
)
from dart_hal.core.config.quantity import Quantities

from .result import number

UNITS = {
    "pwm.oscillator_hz": "Hz", "encoder.metres_per_edge": "m", "encoder.ring": "-",
    "imu.gyro_bias": "rad/s", "imu.gyro_scale": "-", "imu.mount_yaw": "rad",
    "imu.mount_pitch": "rad", "imu.mount_roll": "rad", "throttle.neutral_us": "us",
    "throttle.deadband_forward_us": "us", "throttle.deadband_reverse_us": "us",
    "throttle.saturation_us": "us", "throttle.reverse_rest": "s", "throttle.signal_loss": "s",
    "latency.command_to_pulse": "s", "latency.pulse_to_wheel": "s",
    "latency.pulse_to_wheel_lag": "s", "latency.pulse_to_yaw": "s",
    "latency.pulse_to_yaw_lag": "s", "latency.sensor_to_host": "s", "steering.slew_us_s": "us/s",
    "mocap.marker_x": "m", "mocap.marker_y": "m", "mocap.marker_yaw": "rad", "mocap.latency": "s",
    "lidar.mount_x": "m", "lidar.mount_y": "m", "lidar.mount_yaw": "rad", "lidar.scale": "-",
}
"""Of the quantities that these procedures measure."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What one procedure measured on one car; nothing is written yet while ``written`` is None.

    verb: as in ``calibrate VERB``; quantities by their names in calibration.toml;
    residual: how well the measurements agree, as a sentence; duration [s] of car time;
    others: what is no quantity, by its name in the same way.
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

    def to_json(self) -> dict[str, Any]:
        """The JSON object of ``calibrate VERB``; plain types."""
        return {
            "car": self.car, "source": self.source,
            "quantities": {name: {"value": _plain(q.value), "std": _plain(q.std),
                                  "unit": UNITS[name]} for name, q in self.quantities.items()},
            "others": {name: msgspec.to_builtins(v) for name, v in self.others.items()},
            "residual": self.residual, "duration_s": number(self.duration),
            "written": self.written, "notes": list(self.notes),
        }


def write(files: CarFiles, measured: Measured) -> Measured:
    """Put the quantities and their provenance into the car's calibration.toml.

    The file before goes to history/; what other procedures measured stays.
    Errors: ConfigError, OSError.
    """
    old = calibration_in(files.folder, files.config.name, files.config)
    new = old.with_quantities({name: _rounded(q) for name, q in measured.quantities.items()})
    for name, value in measured.others.items():
        table, _, key = name.partition(".")
        inner = msgspec.structs.replace(getattr(new, table), **{key: value})
        new = msgspec.structs.replace(new, **{table: inner})
    now = datetime.now(timezone.utc).replace(microsecond=0)
    provenance = {**old.provenance, "when": now,
                  measured.verb: {"when": now, "source": measured.source,
                                  "residual": measured.residual,
                                  "duration_s": round(measured.duration, 2)}}
    new = msgspec.structs.replace(new, provenance=provenance)
    new = bind_board(new, files)
    return replace(measured, written=str(save_calibration(new, files.folder, files.config)))


def map_outdated(files: CarFiles, changed: bool, measured_with: str) -> tuple[str, ...]:
    """The caution that a car's steering map hangs on what has ``changed`` since."""
    cal = files.calibration
    if not changed or cal is None or cal.steering.map is None:
        return ()
    return (f"caution: the steering map was measured with {measured_with}: dart-hal calibrate "
            "steering again",)


def _rounded(q: Quantity | Quantities) -> Quantity | Quantities:
    """To a hundredth of the standard error: a file for people, and nothing lost."""
    if isinstance(q, Quantities) or q.std <= 0.0:
        return q
    digits = 2 - math.floor(math.log10(q.std))
    return Quantity(round(q.value, digits), round(q.std, digits), q.method)


def _plain(value: float | tuple[float, ...]) -> Any:
    return [number(v) for v in value] if isinstance(value, tuple) else number(value)
