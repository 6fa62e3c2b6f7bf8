"""What the sensors read, from the history of the motion.

A sample is taken every ``period`` of the car's own time since its reset and can
be read ``age`` later. Between samples the last one stays.
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
from dart_lab.sim.light.config import Encoder, Inertial, Mocap, Sensors, sensor_list, steps_of
from dart_lab.sim.light.effects import Measured
from dart_lab.sim.light.history import History
from dart_lab.sim.light.ops import Ops

TRAVEL, PATH, SPEED, YAW_RATE, ACCEL_X, ACCEL_Y, X, Y, YAW = range(9)
"""Signals of the history: distance and path length [m], then SI units at the centre of mass."""
V_Y, OMEGA_DOT, DRIVE = range(9, 12)
"""More, kept when an effect changes a reading: m/s, rad/s2, force at the wheels [N]."""
SIGNALS = 9, 12
CHANNEL_OF = (0, 1, 2, 2, 3, 3, 3)
"""Number of the sensor that gives each field of a Reading behind t."""
ZEROS = (0.0, 0.0, 0.0, 0.0)

Row = Sequence[Value]


class Reading(NamedTuple):
    """What the sensors say; floats, or arrays of one value per car.

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


def depth_of(sensors: Sensors, step: float, late: Sequence[Value] = ZEROS) -> int:
    """Steps that the history must hold; late: of each sensor beyond its age [s]."""
    looks: list[int] = [
        math.ceil((s.age + float(np.max(more)) + getattr(s, "window", 0.0)) / step)
        + steps_of(s.period, step, type(s).__name__)
        for s, more in zip(sensor_list(sensors), late, strict=True)]
    return max(looks) + 3


EPSILON = 1e-6
"""Of a step: ages this close to whole steps are whole."""


def back_of(time: Value, step: float) -> Value:
    """A time in steps, whole where it is meant to be; also an array (n,) of them."""
    steps = time / step
    if np.ndim(steps):
        return np.where(np.abs(steps - np.rint(steps)) < EPSILON, np.rint(steps), steps)
    return float(round(steps)) if abs(steps - round(steps)) < EPSILON else steps


class Sampler:
    """When a sensor's readings arrive: every ``period`` from the reset on, ``age`` old."""

    def __init__(self, period: float, age: float, step: float, what: str) -> None:
        self.every = steps_of(period, step, what)
        self._back = back_of(age, step)

    def when(self, k: Value) -> tuple[Value, Value]:
        """(steps from the sample until now, steps since it arrived), k steps after the reset."""
        late = k % self.every if self.every > 1 else 0
        return late + self._back, late


class Readings:
    """The sensors of one car or of all; ``read`` after each stretch of steps."""

    def __init__(self, sensors: Sensors, step: float, l_r: float, ops: Ops,
                 draw: Callable[[int, int], Any]) -> None:
        """``draw(stream, columns)`` makes a noise stream. Raises ConfigError."""
        self._ops, self._step, self._l_r = ops, step, l_r
        self._sensors = sensors
        self._samplers = [Sampler(s.period, s.age, step, type(s).__name__)
                          for s in sensor_list(sensors)]
        m = sensors.mocap
        self._streams = [draw(stream, columns) if used else None for stream, columns, used in (
            (noise.ENCODER, 1, sensors.encoder.noise > 0.0),
            (noise.GYRO, 1, sensors.gyro.density > 0.0),
            (noise.ACCEL, 2, sensors.accel.density > 0.0),
            (noise.MOCAP, 4, m.noise > 0.0 or m.yaw_noise > 0.0 or m.dropout > 0.0))]
        self._lost = NormalDist().inv_cdf(m.dropout) if m.dropout > 0.0 else -math.inf
        self._held: Reading | None = None

    def read(self, k: Value, passed: int, past: History, bias: Row, going: Any = True,
             effects: Measured | None = None) -> Reading:
        """Reading ``k`` steps after the reset, ``passed`` steps after the last reading.

        bias: offsets drawn at the reset (gyro, two of the accelerometer);
        going: cars that were not just reset, and so have an older reading.
        """
        e, g, a, m = (stream.row() if stream else ZEROS for stream in self._streams)
        s = self._sensors
        back = [sampler.when(k)[0] for sampler in self._samplers]
        if effects is not None:
            back = [b + back_of(late, self._step)
                    for b, late in zip(back, effects.late, strict=True)]
        speed, pose = self._speed(s.encoder, past, back[0]), self._pose(s.mocap, past, back[3])
        rate = past.at(YAW_RATE, back[1])
        accel = past.at(ACCEL_X, back[2]), past.at(ACCEL_Y, back[2])
        if effects is not None:
            speed, rate, accel, pose = (
                chain(signal, self._now(past, k, b)) if chain.active else signal
                for chain, signal, b in zip(effects.chains, (speed, rate, accel, pose), back,
                                            strict=True))
        c, p = s.encoder, s.mocap
        new = Reading(
            k * self._step, self._rounded(c.scale * speed + c.offset + c.noise * e[0], c.quantum),
            self._rate(s.gyro, rate, bias[0], g[0]),
            self._rate(s.accel, accel[0], bias[1], a[0]),
            self._rate(s.accel, accel[1], bias[2], a[1]),
            pose[0] + p.noise * m[0], pose[1] + p.noise * m[1], pose[2] + p.yaw_noise * m[2])
        self._held = new if self._held is None else self._hold(new, k, passed, m[3], going)
        return self._held

    def _hold(self, new: Reading, k: Value, passed: int, chance: Value, going: Any) -> Reading:
        """``new`` where a sample has arrived since the last reading, else what was held."""
        either = self._ops.either
        keep = [sampler.when(k)[1] >= passed if sampler.every > passed else None
                for sampler in self._samplers]
        if self._lost > -math.inf:
            lost = chance < self._lost
            keep[3] = lost if keep[3] is None else either(keep[3], lost)
        assert self._held is not None
        held = list(new)
        for i, sensor in enumerate(CHANNEL_OF, start=1):
            if (old := keep[sensor]) is not None:
                held[i] = self._ops.choose(self._ops.both(old, going), self._held[i], new[i])
        return Reading(*held)

    def _now(self, past: History, k: Value, back: Value) -> Now:
        """What an effect may know of the moment of a sample."""
        def at(signal: int) -> Value:
            return past.at(signal, back)

        return Now((k - back) * self._step, at(SPEED), at(V_Y), at(YAW_RATE), at(YAW), at(ACCEL_X),
                   at(ACCEL_Y), at(OMEGA_DOT), at(DRIVE), at(TRAVEL) / GEAR_REVOLUTION)

    def _speed(self, p: Encoder, past: History, back: Value) -> Value:
        signal = TRAVEL if p.signed else PATH
        f, window = self._ops.f, p.window
        if window > 0.0:
            end, start = past.at(signal, back), past.at(signal, back + back_of(window, self._step))
            if p.metres_per_count > 0.0:
                q = p.metres_per_count
                end, start = f.floor(end / q) * q, f.floor(start / q) * q
            return (end - start) / window
        v = past.at(SPEED, back)
        return v if p.signed else f.fabs(v)

    def _rate(self, p: Inertial, truth: Value, bias: Value, z: Value) -> Value:
        sigma = p.density * math.sqrt(0.5 / max(p.period, self._step))
        return self._rounded(p.scale * truth + p.offset + bias + sigma * z, p.quantum)

    def _pose(self, p: Mocap, past: History, back: Value) -> tuple[Value, Value, Value]:
        yaw, ahead, f = past.at(YAW, back), p.ahead - self._l_r, self._ops.f
        return (past.at(X, back) + ahead * f.cos(yaw), past.at(Y, back) + ahead * f.sin(yaw), yaw)

    def _rounded(self, v: Value, quantum: float) -> Value:
        return self._ops.f.floor(v / quantum + 0.5) * quantum if quantum > 0.0 else v


