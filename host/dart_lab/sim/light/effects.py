"""Effects on signals in the light simulation: on commands, road-wheel angle and readings.

They work with floats and with arrays. The state of an effect belongs to one car of a batch, and a
reset of that car resets it. All vehicles here have their parameter effects applied.
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

COMMAND_CHANNELS = ("throttle", "steering", "angle")
# Channels of the sensors, in the order of the fields of ``Sensors``.
SENSOR_CHANNELS = ("wheel", "gyro", "accel", "pose")

# States of the effects of a car by channel and name; they remain when parameters change.
Memory = dict[str, Any]


class EffectChain:
    """The effects on one channel, except delays, applied every dt [s]."""

    def __init__(self, p: Vehicle, channel: str, dt: float, ops: Ops, memory: Memory) -> None:
        self._ops = ops
        self._memory = memory
        self._hooks: list[tuple[str, Any, Any]] = []
        for a, signal in signals(p, channel):
            key = f"{channel} {a.name}"
            if isinstance(signal, Stateful):
                self._hooks.append((key, *signal.make(p, ops.f, dt, *a.values)))
            elif not isinstance(signal, PureDelay):
                self._hooks.append(("", None, signal.make(p, ops.f, *a.values)))
        self.active = bool(self._hooks)

    def __call__(self, signal: Any, now: Now) -> Any:
        """Return the signal with the effects."""
        for key, first, step in self._hooks:
            if first is None:
                signal = step(signal, now)
            else:
                signal, *self._memory[key] = step(signal, now, *self._memory.get(key)
                                                  or first(signal))
        return signal

    def start(self, signal: Any, now: Now, which: Any) -> Any:
        """Reset the effects of cars (``which``: True, or array of bool) to a signal; return it."""
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


class ActuatorEffects:
    """One piece of a step with effects between the actuators and the motion.

    The lags are solved exactly; throttle and angle are constant, with their values in the middle of
    the piece. ``throttle``: the last throttle at the motor.
    """

    def __init__(self, p: Vehicle, dt: float, ops: Ops, memory: Memory, motion: Stepper) -> None:
        self.throttle: Value = 0.0
        self._chains = [EffectChain(p, channel, dt, ops, memory) for channel in COMMAND_CHANNELS]
        self._steering = make_steering(p.steering, ops.f)
        self._motion = motion
        self._decays = [lag_decay(lag, dt, ops.f)
                        for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s)]

    def step(self, state: State8, throttle: Value, steering: Value, now: Now) -> State8:
        """Return the state after the piece; throttle, steering: delayed commands -1..1."""
        (start_t, half_t), (start_s, half_s) = self._decays
        # Deviations of the lagged actuators from their commands in the middle of the piece.
        rest_t = half_t * start_t * (state[6] - throttle)
        rest_s = half_s * start_s * (state[7] - steering)
        on_throttle, on_steering, on_angle = self._chains
        self.throttle = tau = on_throttle(throttle + rest_t, now)
        angle = on_angle(self._steering(on_steering(steering + rest_s, now)), now)
        return (*self._motion(state[:6], tau, angle), throttle + half_t * rest_t,
                steering + half_s * rest_s)

    def start(self, state: Sequence[Value], now: Now, which: Any) -> None:
        """Reset cars to the actuators of ``state``."""
        on_throttle, on_steering, on_angle = self._chains
        self.throttle = on_throttle.start(state[6], now, which)
        on_angle.start(self._steering(on_steering.start(state[7], now, which)), now, which)


class SensorEffects:
    """Effects on the readings: ``chains`` and ``delays`` [s] by sensor."""

    def __init__(self, p: Vehicle, step: float, ops: Ops) -> None:
        self.chains = [EffectChain(p, channel, step, ops, {}) for channel in SENSOR_CHANNELS]
        self.delays = [channel_delay(p, channel) for channel in SENSOR_CHANNELS]
        stateful = [a.name for channel in SENSOR_CHANNELS for a, s in signals(p, channel)
                    if isinstance(s, Stateful)]
        if stateful:
            raise UsageError("the light simulation cannot compute sensor effects with a state",
                             found=", ".join(stateful),
                             expected="effects on the present reading",
                             remedy="remove the effect from the model, or use sim://?vehicle=")


def channel_delay(p: Vehicle, channel: str) -> Value:
    """Return the delay of a channel [s]."""
    return sum(s.seconds(*a.values) for a, s in signals(p, channel) if isinstance(s, PureDelay))


def has_command_effects(p: Vehicle) -> bool:
    """Return whether an effect changes a command or the angle."""
    return any(signals(p, channel) for channel in COMMAND_CHANNELS)


def has_sensor_effects(p: Vehicle) -> bool:
    """Return whether an effect changes a reading."""
    return any(signals(p, channel) for channel in SENSOR_CHANNELS)


def keep_force_effects(p: Vehicle) -> Vehicle:
    """Return the vehicle with only those effects that are part of the equations of motion."""
    return replace(p, effects=tuple(a for a in p.effects if a.effect.force is not None))


def drop_null_effects(p: Vehicle) -> Vehicle:
    """Return the vehicle without signal effects that change nothing."""
    return replace(p, effects=tuple(
        a for a in p.effects if a.effect.vehicle or a.effect.force
        or any(np.any(v != n) for v, n in zip(a.values, a.effect.nulls, strict=True))))


def check_delays(p: Vehicle, sensors: Sensors | None) -> None:
    """Raise UsageError for a delay of a command, and for a negative delay of a reading."""
    delays = [(a.name, channel) for channel in (*COMMAND_CHANNELS, *SENSOR_CHANNELS)
              for a, s in signals(p, channel) if isinstance(s, PureDelay)]
    of_commands = sorted({name for name, channel in delays if channel in COMMAND_CHANNELS})
    if of_commands:
        raise UsageError("the delay of a command is a parameter of the vehicle",
                         found=", ".join(of_commands),
                         expected="delay.steering_s, delay.throttle_s")
    ages: Mapping[str, float] = {} if sensors is None else dict(zip(
        SENSOR_CHANNELS, (s.age for s in sensor_list(sensors)), strict=True))
    for name, channel in delays:
        delay = channel_delay(p, channel)
        if np.any(ages.get(channel, 0.0) + delay < 0.0):
            raise UsageError(f"{name} would need the future",
                             found=f"a {channel} reading delayed by {delay} s",
                             expected=f"0 s or more, with the age of {ages.get(channel, 0.0)} s",
                             remedy=f"give {name} the other sign, or the sensors an age")
