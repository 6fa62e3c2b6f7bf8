"""Effects on signals in the light simulation: on commands, on the angle, on what sensors read.

Floats and arrays alike. Where an effect has a memory, every car of a batch has
its own, and it begins anew with that car.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import Vehicle, make_steering
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.effect import Now, PureDelay, Stateful
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.step import lag_decay
from dart_lab.sim.light.config import Sensors, sensor_list
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.stepper import State8, Stepper

COMMANDS = ("throttle", "steering", "angle")
SENSORS = ("wheel", "gyro", "accel", "pose")
"""Channels of the sensors, in the order of the fields of ``Sensors``."""

Memory = dict[str, Any]
"""What the effects of a car remember, by channel and name; kept when parameters change."""


class Chain:
    """The effects on one channel that act at once, every dt [s]; p is settled."""

    def __init__(self, p: Vehicle, channel: str, dt: float, ops: Ops, memory: Memory) -> None:
        self._ops, self._memory = ops, memory
        self._hooks: list[tuple[str, Any, Any]] = []
        for a, signal in signals(p, channel):
            key = f"{channel} {a.name}"
            if isinstance(signal, Stateful):
                self._hooks.append((key, *signal.make(p, ops.f, dt, *a.values)))
            elif not isinstance(signal, PureDelay):
                self._hooks.append(("", None, signal.make(p, ops.f, *a.values)))
        self.active = bool(self._hooks)

    def __call__(self, signal: Any, now: Now) -> Any:
        """The signal behind the effects."""
        for key, first, step in self._hooks:
            if first is None:
                signal = step(signal, now)
            else:
                signal, *self._memory[key] = step(signal, now, *self._memory.get(key)
                                                  or first(signal))
        return signal

    def start(self, signal: Any, now: Now, which: Any) -> Any:
        """The same for cars (``which``: True, or an array of bool) that begin with this signal."""
        choose = self._ops.choose
        for key, first, step in self._hooks:
            if first is None:
                signal = step(signal, now)
                continue
            new = first(signal)
            old = self._memory.get(key, new)
            self._memory[key] = [choose(which, n, o) for n, o in zip(new, old, strict=True)]
            signal = step(signal, now, *self._memory[key])[0]
        return signal


class Acting:
    """One piece of a step with effects between the actuators and the motion.

    The lags are solved exactly; throttle and angle are held at what they are
    in the middle of the piece. ``throttle``: what the motor had, at last.
    """

    def __init__(self, p: Vehicle, dt: float, ops: Ops, memory: Memory, motion: Stepper) -> None:
        self.throttle: Value = 0.0
        self._chains = [Chain(p, channel, dt, ops, memory) for channel in COMMANDS]
        self._steering = make_steering(p.steering, ops.f)
        self._motion = motion
        self._decays = [lag_decay(lag, dt, ops.f)
                        for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s)]

    def step(self, state: State8, throttle: Value, steering: Value, now: Now) -> State8:
        """State after the piece with commands -1..1 behind their delays."""
        (start_t, half_t), (start_s, half_s) = self._decays
        left_t = half_t * start_t * (state[6] - throttle)
        left_s = half_s * start_s * (state[7] - steering)
        pull, turn, bend = self._chains
        self.throttle = tau = pull(throttle + left_t, now)
        angle = bend(self._steering(turn(steering + left_s, now)), now)
        return (*self._motion(state[:6], tau, angle), throttle + half_t * left_t,
                steering + half_s * left_s)

    def start(self, state: Sequence[Value], now: Now, which: Any) -> None:
        """Cars begin with the actuators where ``state`` has them."""
        pull, turn, bend = self._chains
        self.throttle = pull.start(state[6], now, which)
        bend.start(self._steering(turn.start(state[7], now, which)), now, which)


class Measured:
    """Effects on what the sensors read: ``chains`` and lateness [s] by sensor; p is settled."""

    def __init__(self, p: Vehicle, step: float, ops: Ops) -> None:
        self.chains = [Chain(p, channel, step, ops, {}) for channel in SENSORS]
        self.late = [lateness(p, channel) for channel in SENSORS]
        kept = [a.name for channel in SENSORS for a, s in signals(p, channel)
                if isinstance(s, Stateful)]
        if kept:
            raise UsageError("a sensor of the light simulation has no memory",
                             found=", ".join(kept), expected="effects on the reading of a moment",
                             remedy="leave the effect out of the model, or drive sim://?vehicle=")


def lateness(p: Vehicle, channel: str) -> Value:
    """By how much a channel comes late [s]."""
    return sum(s.seconds(*a.values) for a, s in signals(p, channel) if isinstance(s, PureDelay))


def acts(p: Vehicle) -> bool:
    """Whether an effect changes a command or the angle."""
    return any(signals(p, channel) for channel in COMMANDS)


def measures(p: Vehicle) -> bool:
    """Whether an effect changes what a sensor reads."""
    return any(signals(p, channel) for channel in SENSORS)


def motion_of(p: Vehicle) -> Vehicle:
    """The settled vehicle with those effects alone that its equations of motion know."""
    return replace(p, effects=tuple(a for a in p.effects if a.effect.force is not None))


def without_null(p: Vehicle) -> Vehicle:
    """The vehicle without effects on signals that change nothing."""
    return replace(p, effects=tuple(
        a for a in p.effects if a.effect.vehicle or a.effect.force
        or any(np.any(v != n) for v, n in zip(a.values, a.effect.nulls, strict=True))))


def check(p: Vehicle, sensors: Sensors | None) -> None:
    """Raises UsageError for an effect that would need the future."""
    late = [(a.name, channel) for channel in (*COMMANDS, *SENSORS)
            for a, s in signals(p, channel) if isinstance(s, PureDelay)]
    waiting = sorted({name for name, channel in late if channel in COMMANDS})
    if waiting:
        raise UsageError("a command that comes late is a delay of the vehicle",
                         found=", ".join(waiting), expected="delay.steering_s, delay.throttle_s")
    ages: Mapping[str, float] = {} if sensors is None else dict(zip(
        SENSORS, (s.age for s in sensor_list(sensors)), strict=True))
    for name, channel in late:
        if np.any(ages.get(channel, 0.0) + lateness(p, channel) < 0.0):
            raise UsageError(f"{name} would need the future",
                             found=f"a {channel} reading {lateness(p, channel)} s late",
                             expected=f"0 s or more, with the age of {ages.get(channel, 0.0)} s",
                             remedy=f"give {name} the other sign, or the sensors an age")
