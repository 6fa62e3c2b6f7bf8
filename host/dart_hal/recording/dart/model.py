"""A DART recording in memory: frozen, SI units, read-only arrays."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.config.car import CarConfig
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale, find_scale

# s without a reading of the battery up to which its voltage counts as measured: eight readings.
MAX_BATTERY_GAP = 2.0
RUN = "run"  # schema of a run of our own, read as a recording


@dataclass(frozen=True, slots=True)
class Note:
    """Something that was dropped or changed while reading: why, and how many rows.

    kind: one word for programs, of the table in docs/reference/recordings.md.
    """

    why: str
    rows: int = 0
    kind: str = "read"

    def __str__(self) -> str:
        return f"{self.why}: {self.rows} row(s)" if self.rows else self.why


@dataclass(frozen=True, slots=True)
class Messages:
    """The 10 Hz sensor messages (schema C: the command rows), m of them, each once.

    t (m,) s: stamp of the sensor node, advancing; arrival (m,) s: when the
    recorder had it, on the clock of ``Mocap.t`` (schema A: the same as t).
    segment (m,): counts up at each step back or gap above 0.3 s: never
    differentiate or filter across. throttle (m,) -1..1 behind the safety gate,
    throttle_raw before it, steering (m,) -1..1 (not gated), gate (m,).
    speed (m,) m/s of the drive shaft, unsigned, mean of the last 0.1 s; yaw_rate
    (m,) rad/s; accel_x, accel_y (m,) m/s2 with gravity and tilt. NaN where the
    recording has no such sensor, or a dead one.
    """

    t: FloatArray
    arrival: FloatArray
    segment: IntArray
    throttle: FloatArray
    throttle_raw: FloatArray
    steering: FloatArray
    gate: BoolArray
    speed: FloatArray
    yaw_rate: FloatArray
    accel_x: FloatArray
    accel_y: FloatArray

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Mocap:
    """Pose of the marker frame, n rows with advancing time.

    t (n,) s from the first row; epoch: Unix time of t = 0, None if unknown;
    x, y (n,) m, yaw (n,) rad unwrapped; outlier (n,): a jump of 1 to 3 rows.
    """

    t: FloatArray
    epoch: float | None
    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    outlier: BoolArray

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Reference:
    """Marker frame: L_x, L_y [m] from the rear axle, theta [rad]; source in words.

    std: standard errors of L_x, theta and L_y, NaN where one was not measured; None: not known.

    Example:
        >>> from dart_hal import Reference
        >>> print(Reference(0.115, 0.01, -0.01))
        L_x +0.1150 m, theta +0.0100 rad, L_y -0.0100 m
    """

    lx: float
    theta: float
    ly: float
    source: str = "given"
    std: tuple[float, float, float] | None = None

    def __str__(self) -> str:
        values = (("L_x", self.lx, "m"), ("theta", self.theta, "rad"), ("L_y", self.ly, "m"))
        if self.std is None:
            return ", ".join(f"{name} {value:+.4f} {unit}" for name, value, unit in values)
        return ", ".join(f"{name} {value:+.4f} +- {error:.4f} {unit}" if np.isfinite(error)
                         else f"{name} {value:+.4f} {unit} (not measured)"
                         for (name, value, unit), error in zip(values, self.std, strict=True))

    def to_json(self) -> dict[str, Any]:
        """Return the entries of one frame in the ``--json`` output of the verbs."""
        names = ("lx", "theta", "ly")
        std = None if self.std is None else {
            name: error if np.isfinite(error) else None
            for name, error in zip(names, self.std, strict=True)}
        return {"lx": self.lx, "theta": self.theta, "ly": self.ly, "source": self.source,
                "std": std}

    def marker(self, l_r: float, x: FloatArray, y: FloatArray, yaw: FloatArray
               ) -> tuple[FloatArray, FloatArray]:
        """Return x, y of the marker for a pose of the centre of mass, l_r [m] before the axle."""
        forward = self.lx - l_r
        c = np.cos(yaw)
        s = np.sin(yaw)
        return x + forward * c - self.ly * s, y + forward * s + self.ly * c

    def centre(self, l_r: float, pose: tuple[FloatArray, FloatArray, FloatArray],
               rates: tuple[FloatArray, FloatArray, FloatArray]) -> tuple[FloatArray, ...]:
        """Return x, y, v_x, v_y of the centre of mass for x, y, yaw of the marker and their rates.

        The position follows by subtracting the lever arm, turned by the yaw; its velocity is
        omega times the arm.
        """
        x, y, yaw = pose
        dx, dy, omega = rates
        forward = self.lx - l_r
        c = np.cos(yaw)
        s = np.sin(yaw)
        return (x - forward * c + self.ly * s, y - forward * s - self.ly * c,
                c * dx + s * dy + omega * self.ly, -s * dx + c * dy - omega * forward)


@dataclass(frozen=True, slots=True)
class AppliedCommands:
    """Throttle and steering (m,) that were written at t (m,) s, each valid until the next.

    t is on the clock of the motion capture. A message only has the command of its moment, which
    was written up to two frames before.
    """

    t: FloatArray
    throttle: FloatArray
    steering: FloatArray

    def sample_means(self, n: int) -> tuple[FloatArray, FloatArray]:
        """Compute the means of (throttle, steering) over n samples of the grid, (n,) each."""
        edges = np.arange(n + 1) * SAMPLE
        # Integral of the zero-order hold up to each edge of the grid: its sum at the commands, and
        # constant before the first and after the last one.
        since = np.maximum(edges - self.t[-1], 0.0)

        def means(values: FloatArray) -> FloatArray:
            total = np.concatenate([[0.0], np.cumsum(np.diff(self.t) * values[:-1])])
            before = np.minimum(edges - self.t[0], 0.0) * values[0]
            integral = np.interp(edges, self.t, total) + since * values[-1] + before
            # Rounded, because differences of sums of a constant vary by rounding errors.
            return np.asarray(np.round(np.diff(integral) / SAMPLE, 9))

        return means(self.throttle), means(self.steering)


@dataclass(frozen=True, slots=True)
class BatteryVoltage:
    """Measured voltage (m,) [V] of the battery at t (m,) s, on the clock of the recording."""

    t: FloatArray
    voltage: FloatArray

    def interpolate(self, t: FloatArray) -> FloatArray:
        """Return the voltage [V] at t (n,) s; it is constant before and after the readings."""
        return np.asarray(np.interp(t, self.t, self.voltage))


def select_voltage(t: FloatArray, voltage: FloatArray, first: float, last: float
                   ) -> BatteryVoltage | None:
    """Return readings (m,) [V] at t (m,) s; None if ``first`` to ``last`` s has a longer gap.

    The gap is ``MAX_BATTERY_GAP``. A reading that is not above 0 is none.
    """
    valid = np.isfinite(voltage) & (voltage > 0.0)
    t = t[valid]
    voltage = voltage[valid]
    within = t[(t >= first) & (t <= last)]
    gaps = np.diff(np.concatenate([[first], within, [last]]))
    if not len(t) or gaps.max() > MAX_BATTERY_GAP:
        return None
    return BatteryVoltage(freeze(t), freeze(voltage))


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording.

    schema: "A", "B", "C" or RUN. mocap: None for A, and for a RUN without external poses.

    encoder: "ok", "dead" (always 0 while the car moved, or stuck), "zero" (always 0, and no other
    sensor shows a motion), "none" (schema C). quantum: m/s per encoder count, None if it cannot be
    inferred. sha256 of the file's bytes.
    rows: lines of the table before any was dropped (0: no table).
    mass: weighed for this recording, (kg, standard deviation); None: not weighed.
    marker: marker frame that this recording itself states.
    span [s]: messages are means over this time before their stamp; 0: samples.
    car: the car file in a run or named for it; None for other recordings.
    published: its content is that of a published file of DART. framed: ``marker`` and the notes
    about it are those of ``with_marker_frames``. commands: with the times at which they were
    written, if recorded; None: those of the messages.
    spans [s]: intervals that may be evaluated, see ``spans``; empty: the whole recording.
    drive: "duty": throttles are -1..1; "speed": they are the commanded speeds [m/s] of a speed
    loop, also in ``messages`` and ``commands``.
    steering_scale: logged steering angle [rad] of the command 1; None: the log has no angle.
    battery: its voltage if measured throughout.
    """

    path: Path
    schema: str
    messages: Messages
    mocap: Mocap | None
    encoder: str
    quantum: float | None
    sha256: str
    notes: tuple[Note, ...]
    rows: int = 0
    mass: tuple[float, float] | None = None
    marker: Reference | None = None
    span: float = 0.0
    car: CarConfig | None = None
    published: bool = False
    framed: bool = False
    commands: AppliedCommands | None = None
    spans: tuple[tuple[float, float], ...] = ()
    drive: str = "duty"
    steering_scale: float | None = None
    battery: BatteryVoltage | None = None

    @property
    def name(self) -> str:
        """Folder and file name, for tables and messages."""
        folder = self.path.parent.name or self.path.absolute().parent.name
        return f"{folder}/{self.path.name}"

    @property
    def scale(self) -> Scale:
        """Scale of its car, by which limits of speeds and lengths are; without one that of 1:10."""
        return REFERENCE_SCALE if self.car is None else find_scale(self.car.geometry)

    @property
    def of_means(self) -> bool:
        """Whether messages are means over the ``span`` before their stamp."""
        return self.span > 0.0

    @property
    def duration(self) -> float:
        """Recorded time [s] without the gaps between segments."""
        step = np.diff(self.messages.t)
        same = np.diff(self.messages.segment) == 0
        return float(step[same].sum())

    @property
    def when(self) -> datetime | None:
        """Start in UTC by the mocap clock (schemas B, C with epoch stamps), else None."""
        if self.mocap is None or self.mocap.epoch is None:
            return None
        return datetime.fromtimestamp(self.mocap.epoch, tz=timezone.utc)


def freeze(values: NDArray[Any]) -> FloatArray:
    """Return a read-only copy as floats; negative zeros become zeros."""
    out: FloatArray = np.array(values, dtype=np.float64) + 0.0
    out.setflags(write=False)
    return out


def freeze_flags(values: NDArray[Any]) -> BoolArray:
    """Return a read-only copy as booleans."""
    out: BoolArray = np.array(values, dtype=np.bool_)
    out.setflags(write=False)
    return out


def freeze_index(values: NDArray[Any]) -> IntArray:
    """Return a read-only copy as integers."""
    out: IntArray = np.array(values, dtype=np.int64)
    out.setflags(write=False)
    return out
