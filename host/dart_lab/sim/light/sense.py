"""Readings of the sensors, from the history of the motion.

A sample is taken every ``period`` of the car's time since its reset and can be read ``age`` later.
The reading is that of the last sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import GEAR_REVOLUTION
from dart_lab.sim.light import noise
from dart_lab.sim.light.config import Encoder, Inertial, Mocap, Sensors, sensor_list, whole_steps
from dart_lab.sim.light.effects import SensorEffects
from dart_lab.sim.light.history import History
from dart_lab.sim.light.ops import Ops

# Signals of the history: distance and path length [m], then SI units at the centre of mass.
(SIGNAL_TRAVEL, SIGNAL_PATH, SIGNAL_SPEED, SIGNAL_YAW_RATE, SIGNAL_ACCEL_X, SIGNAL_ACCEL_Y,
 SIGNAL_X, SIGNAL_Y, SIGNAL_YAW) = range(9)
# Further signals, if an effect changes a reading: m/s, rad/s2, force at the wheels [N].
SIGNAL_V_Y, SIGNAL_OMEGA_DOT, SIGNAL_DRIVE = range(9, 12)
# Number of signals without and with the further ones.
SIGNAL_COUNTS = 9, 12
# Index of the sensor of each field of a Reading after t.
SENSOR_OF_FIELD = (0, 1, 2, 2, 3, 3, 3)
ZEROS = (0.0, 0.0, 0.0, 0.0)

Row = Sequence[Value]


class Reading(NamedTuple):
    """Readings of the sensors; floats, or arrays of one value per car.

    t [s] since the reset; speed [m/s]; yaw_rate [rad/s]; accel_x, accel_y
    [m/s2]; x, y [m], yaw [rad, unwrapped]: pose of the rear axle.
    """

    t: Value
    speed: Value
    yaw_rate: Value
    accel_x: Value
    accel_y: Value
    x: Value
    y: Value
    yaw: Value


def history_depth(sensors: Sensors, step: float, delays: Sequence[Value] = ZEROS) -> int:
    """Return the steps of the history; delays: of each sensor in addition to its age [s]."""
    depths: list[int] = [
        math.ceil((s.age + float(np.max(delay)) + getattr(s, "window", 0.0)) / step)
        + whole_steps(s.period, step, type(s).__name__)
        for s, delay in zip(sensor_list(sensors), delays, strict=True)]
    return max(depths) + 3


# Ages this close to a whole number of steps are whole [steps].
WHOLE_STEP_TOLERANCE = 1e-6


def to_steps(time: Value, step: float) -> Value:
    """Return a time, or an array (n,) of times, in steps, without rounding errors."""
    steps = time / step
    if np.ndim(steps):
        whole = np.rint(steps)
        return np.where(np.abs(steps - whole) < WHOLE_STEP_TOLERANCE, whole, steps)
    return float(round(steps)) if abs(steps - round(steps)) < WHOLE_STEP_TOLERANCE else steps


class Sampler:
    """Times of the readings of a sensor: every ``period`` from the reset on, ``age`` old."""

    def __init__(self, period: float, age: float, step: float, what: str) -> None:
        self.every = whole_steps(period, step, what)
        self._back = to_steps(age, step)

    def when(self, k: Value) -> tuple[Value, Value]:
        """Return (age of the last sample, steps since its arrival), k steps after the reset."""
        since = k % self.every if self.every > 1 else 0
        return since + self._back, since


class SensorModel:
    """The sensors of one car or of all cars."""

    def __init__(self, sensors: Sensors, step: float, l_r: float, ops: Ops,
                 draw: Callable[[int, int], Any]) -> None:
        """``draw(stream, columns)`` makes a noise stream. Raises ConfigError."""
        self._ops = ops
        self._step = step
        self._l_r = l_r
        self._sensors = sensors
        self._samplers = [Sampler(s.period, s.age, step, type(s).__name__)
                          for s in sensor_list(sensors)]
        m = sensors.mocap
        self._streams = [draw(stream, columns) if used else None for stream, columns, used in (
            (noise.ENCODER_STREAM, 1, sensors.encoder.noise > 0.0),
            (noise.GYRO_STREAM, 1, sensors.gyro.density > 0.0),
            (noise.ACCEL_STREAM, 2, sensors.accel.density > 0.0),
            (noise.MOCAP_STREAM, 4, m.noise > 0.0 or m.yaw_noise > 0.0 or m.dropout > 0.0))]
        self._dropout_limit = NormalDist().inv_cdf(m.dropout) if m.dropout > 0.0 else -math.inf
        self.last_reading: Reading | None = None

    def read(self, k: Value, passed: int, past: History, bias: Row, going: Any = True,
             effects: SensorEffects | None = None) -> Reading:
        """Return the reading ``k`` steps after the reset, ``passed`` steps after the last reading.

        1. Take the signals of the history at the times of the last samples.
        2. Apply the effects on readings, then scale, offset, noise and quantum.
        3. Repeat the last reading where no new sample has arrived.

        bias: offsets drawn at the reset (gyro, two of the accelerometer); going: cars that were not
        just reset and so have an older reading.
        """
        e, g, a, m = (stream.row() if stream else ZEROS for stream in self._streams)
        s = self._sensors
        back = [sampler.when(k)[0] for sampler in self._samplers]
        if effects is not None:
            back = [b + to_steps(delay, self._step)
                    for b, delay in zip(back, effects.delays, strict=True)]
        speed = self._speed(s.encoder, past, back[0])
        pose = self._pose(s.mocap, past, back[3])
        rate = past.value(SIGNAL_YAW_RATE, back[1])
        accel = past.value(SIGNAL_ACCEL_X, back[2]), past.value(SIGNAL_ACCEL_Y, back[2])
        if effects is not None:
            speed, rate, accel, pose = (
                chain(signal, self._now(past, k, b)) if chain.active else signal
                for chain, signal, b in zip(effects.chains, (speed, rate, accel, pose), back,
                                            strict=True))
        c = s.encoder
        p = s.mocap
        new = Reading(
            k * self._step, self._quantise(c.scale * speed + c.offset + c.noise * e[0], c.quantum),
            self._inertial(s.gyro, rate, bias[0], g[0]),
            self._inertial(s.accel, accel[0], bias[1], a[0]),
            self._inertial(s.accel, accel[1], bias[2], a[1]),
            pose[0] + p.noise * m[0], pose[1] + p.noise * m[1], pose[2] + p.yaw_noise * m[2])
        if self.last_reading is not None:
            new = self._hold(new, k, passed, m[3], going)
        self.last_reading = new
        return new

    def _hold(self, new: Reading, k: Value, passed: int, chance: Value, going: Any) -> Reading:
        """Return ``new`` where a sample has arrived since the last reading, else that reading."""
        either = self._ops.either
        keep = [sampler.when(k)[1] >= passed if sampler.every > passed else None
                for sampler in self._samplers]
        if self._dropout_limit > -math.inf:
            lost = chance < self._dropout_limit
            keep[3] = lost if keep[3] is None else either(keep[3], lost)
        last = self.last_reading
        assert last is not None
        held = list(new)
        for i, sensor in enumerate(SENSOR_OF_FIELD, start=1):
            if (old := keep[sensor]) is not None:
                held[i] = self._ops.choose(self._ops.both(old, going), last[i], new[i])
        return Reading(*held)

    def _now(self, past: History, k: Value, back: Value) -> Now:
        """Return the state at the time of a sample, on which an effect may depend."""
        def value(signal: int) -> Value:
            return past.value(signal, back)

        return Now((k - back) * self._step, value(SIGNAL_SPEED), value(SIGNAL_V_Y),
                   value(SIGNAL_YAW_RATE), value(SIGNAL_YAW), value(SIGNAL_ACCEL_X),
                   value(SIGNAL_ACCEL_Y), value(SIGNAL_OMEGA_DOT), value(SIGNAL_DRIVE),
                   value(SIGNAL_TRAVEL) / GEAR_REVOLUTION)

    def _speed(self, p: Encoder, past: History, back: Value) -> Value:
        signal = SIGNAL_TRAVEL if p.signed else SIGNAL_PATH
        f = self._ops.f
        window = p.window
        if window > 0.0:
            end = past.value(signal, back)
            start = past.value(signal, back + to_steps(window, self._step))
            if p.metres_per_count > 0.0:
                q = p.metres_per_count
                end = f.floor(end / q) * q
                start = f.floor(start / q) * q
            return (end - start) / window
        v = past.value(SIGNAL_SPEED, back)
        return v if p.signed else f.fabs(v)

    def _inertial(self, p: Inertial, truth: Value, bias: Value, z: Value) -> Value:
        sigma = p.density * math.sqrt(0.5 / max(p.period, self._step))
        return self._quantise(p.scale * truth + p.offset + bias + sigma * z, p.quantum)

    def _pose(self, p: Mocap, past: History, back: Value) -> tuple[Value, Value, Value]:
        yaw = past.value(SIGNAL_YAW, back)
        ahead = p.ahead - self._l_r
        f = self._ops.f
        return (past.value(SIGNAL_X, back) + ahead * f.cos(yaw),
                past.value(SIGNAL_Y, back) + ahead * f.sin(yaw), yaw)

    def _quantise(self, v: Value, quantum: float) -> Value:
        return self._ops.f.floor(v / quantum + 0.5) * quantum if quantum > 0.0 else v
