"""Simulation from command to reading without firmware, for ``LightCar`` and ``LightBatch``.

One step:

1. Put the commands into the queue of the pure delays.
2. Integrate actuators and bicycle (``vehicle.make_car_step``) over each piece of the step.
3. Add the impulse of the disturbance to the velocities.
4. Put the signals into the history, from which the sensors are computed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.light import noise
from dart_lab.sim.light.chain import make_command_shaping, make_slew, split_step
from dart_lab.sim.light.config import PERFECT, LightConfig
from dart_lab.sim.light.effects import (
    SENSOR_CHANNELS,
    ActuatorEffects,
    Memory,
    SensorEffects,
    channel_delay,
    check_delays,
    drop_null_effects,
    has_command_effects,
    has_sensor_effects,
    keep_force_effects,
)
from dart_lab.sim.light.force import RandomForce
from dart_lab.sim.light.history import History
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.sense import SIGNAL_COUNTS, Reading, SensorModel, history_depth
from dart_lab.sim.light.stepper import State8, Stepper, Substeps, find_substeps

# ``make(vehicle, duration, method, substeps, kind="car")``, see ``stepper``.
MakeStepper = Callable[..., Stepper]
Move = Callable[[State8, Value, Value], State8]


class LightPlant:
    """State and history of one car or of a batch; the values are floats or arrays."""

    def __init__(self, vehicle: Vehicle, config: LightConfig, ops: Ops,
                 make_stepper: MakeStepper, seeds: Sequence[noise.Seed], scalar: bool,
                 nominal: Vehicle) -> None:
        self.config = config
        self.ops = ops
        self._scalar = scalar
        self._make_stepper = make_stepper
        self._nominal = apply_parameter_effects(nominal)
        self.state: State8 = ()
        self.k: Value = 0
        self._shape = make_command_shaping(config.actuators, ops)
        self._slew = make_slew(config.actuators.steering_rate, ops)
        self._limited = config.actuators.steering_rate < 100.0 / config.step
        delay = self._nominal.delay
        self._pieces = split_step(config.step, delay.throttle_s, delay.steering_s)
        self._queue: deque[tuple[Value, Value]] = deque(
            maxlen=1 + max(max(p.throttle, p.steering) for p in self._pieces))
        self._servo: Value = 0.0
        self._force = (RandomForce(config.disturbance, vehicle.body.mass, config.step)
                      if config.disturbance.acts else None)
        self._history: History | None = None
        self._memory: Memory = {}
        self._depth, self._signals = self._history_size(vehicle, 2.0)
        self._travel: Value = 0.0
        self._path: Value = 0.0
        self._bias: Any = (0.0, 0.0, 0.0)
        self._passed = 0
        self._ticks: Value = 0
        self.set_vehicle(vehicle)
        self.seed(seeds)

    def set_vehicle(self, vehicle: Vehicle) -> None:
        """Make the equations of other parameters; pure delays remain those of the first vehicle.

        Raises UsageError for an effect with a negative delay, or with a longer history than that of
        the first vehicle.
        """
        c = self.config
        p = drop_null_effects(apply_parameter_effects(vehicle))
        check_delays(p, c.sensors)
        depth, signals = self._history_size(vehicle)
        if depth > self._depth or signals > self._signals:
            raise UsageError("the history of the sensors is too short for this vehicle",
                             found="an effect on readings that the first vehicle does not have, or "
                                   "more than twice its delay", expected="the effects of the first",
                             remedy="make another car for this vehicle")
        self.vehicle = vehicle
        self._actuator_effects: list[ActuatorEffects] = []
        self._steppers = tuple(
            (piece, self._make_move(p, piece.duration,
                                    find_substeps(vehicle, piece.duration, c.method,
                                                  self.ops.arrays)))
            for piece in self._pieces)
        self._sensor_effects = SensorEffects(p, c.step, self.ops) if has_sensor_effects(p) else None
        self._drive = make_drive(p.duty_motor, p.friction, self.ops.f)
        if self._force is not None:
            self._force.set_mass(p.body.mass)

    def _make_move(self, p: Vehicle, duration: float, substeps: Substeps) -> Move:
        method = self.config.method
        moving = keep_force_effects(p)
        if not has_command_effects(p):
            return self._make_stepper(moving, duration, method, substeps)
        motion = self._make_stepper(moving, duration, method, substeps, "motion")
        effects = ActuatorEffects(p, duration, self.ops, self._memory, motion)
        self._actuator_effects.append(effects)

        def move(state: State8, throttle: Value, steering: Value) -> State8:
            return effects.step(state, throttle, steering, self._now(state))

        return move

    def _now(self, state: Sequence[Value]) -> Now:
        """Return the state on which an effect on a command may depend."""
        return Now(self._ticks * self.config.step, state[3], state[4], state[5], state[2])

    def _history_size(self, vehicle: Vehicle, growth: float = 1.0) -> tuple[int, int]:
        """Return (steps, signals) of the history if the delays are multiplied by ``growth``."""
        c = self.config
        p = drop_null_effects(apply_parameter_effects(vehicle))
        if c.sensors is None or not has_sensor_effects(p):
            return (0 if c.sensors is None else history_depth(c.sensors, c.step)), SIGNAL_COUNTS[0]
        delays = [growth * np.maximum(channel_delay(p, channel), 0.0)
                  for channel in SENSOR_CHANNELS]
        return history_depth(c.sensors, c.step, delays), SIGNAL_COUNTS[1]

    def _start_effects(self, which: Any) -> None:
        """Reset the effects with a state for some cars: True, or an array of bool."""
        self._ticks = self.k
        # The pieces of a step share one memory.
        for effects in self._actuator_effects[:1]:
            effects.start(self.state, self._now(self.state), which)

    def seed(self, seeds: Sequence[noise.Seed]) -> None:
        """Start all noise again, with one seed for each car."""
        c = self.config

        def draw(stream: int, columns: int) -> Any:
            return self.make_stream(seeds, stream, columns)

        self._force_noise = draw(noise.FORCE_STREAM, 2) if self._force else None
        self._starts = [noise.make_generator(seed, noise.START_STREAM) for seed in seeds]
        self._passed = 0
        self._sensor_model = (None if c.sensors is None else
                          SensorModel(c.sensors, c.step, self._nominal.body.l_r, self.ops, draw))

    def make_stream(self, seeds: Sequence[noise.Seed], stream: int, columns: int) -> Any:
        """Make one stream of noise."""
        return noise.make_stream(seeds, stream, columns, self._scalar, self.config.dtype)

    def begin(self, state: State8, row: Sequence[Value]) -> None:
        """Begin with a state; row: five standard normal numbers for three biases and the force."""
        self.k = 0
        self.state = state
        self._servo = state[7]
        # The delayed commands before the start are those of the start.
        self._queue.extend([(state[6], state[7])] * (self._queue.maxlen or 1))
        self._bias = self._offsets(row)
        if self._force is not None:
            self._force.force = self._force.start(row[3:])
        self._travel = self._path = 0.0
        self._start_effects(True)
        if self._history is not None:
            self._history.fill(self._extrapolate_past(state))

    def advance(self, throttle: Value, steering: Value, steps: int = 1) -> State8:
        """Return the state after ``steps`` steps with constant commands -1..1."""
        command = self._shape(throttle, steering)
        for i in range(steps):
            self._ticks = self.k + i
            self._queue.appendleft(command)
            old = self.state
            self._move()
            if self._history is not None:
                self._record(old, self._history)
        self.k = self.k + steps
        self._passed += steps
        return self.state

    def _move(self) -> None:
        queue = self._queue
        state = self.state
        for piece, stepper in self._steppers:
            s = queue[piece.steering][1]
            if self._limited:
                self._servo, s = self._slew(self._servo, s, piece.duration)
            state = stepper(state, queue[piece.throttle][0], s)
        if self._force is not None and self._force_noise is not None:
            state = self._force(state, self._force_noise.row())
        self.state = state

    def _record(self, old: State8, past: History) -> None:
        """Record the signals at the end of the step; accelerations are means over it."""
        dt = self.config.step
        f = self.ops.f
        _, _, _, u0, v0, r0, _, _ = old
        x, y, yaw, u, v, r, _, _ = self.state
        self._travel = self._travel + 0.5 * dt * (u0 + u)
        self._path = self._path + 0.5 * dt * (f.fabs(u0) + f.fabs(u))
        turn = 0.25 * (r0 + r)
        signals: tuple[Value, ...] = (
            self._travel, self._path, u, r, (u - u0) / dt - turn * (v0 + v),
            (v - v0) / dt + turn * (u0 + u), x, y, yaw)
        if self._signals > SIGNAL_COUNTS[0]:
            throttle = (self._actuator_effects[-1].throttle if self._actuator_effects
                        else self.state[6])
            signals = (*signals, v, (r - r0) / dt, self._drive(throttle, u))
        past.push(signals)

    def skip(self, steps: int) -> None:
        """Draw and drop the disturbance of ``steps`` steps, as if the car had been driven."""
        if self._force_noise is not None:
            for _ in range(steps):
                self._force_noise.row()

    def _offsets(self, row: Sequence[Value]) -> tuple[Value, Value, Value]:
        """Return the biases of gyro and accelerometer from three standard normal numbers."""
        s = self.config.sensors or PERFECT
        return (s.gyro.offset_spread * row[0], s.accel.offset_spread * row[1],
                s.accel.offset_spread * row[2])

    def read(self, going: Any = True) -> Reading:
        """Return the sensor readings now. Raises UsageError without sensors."""
        if self._sensor_model is None or self._history is None:
            raise UsageError("this light car has no sensors", found="LightConfig(sensors=None)",
                             expected="LightConfig(sensors=PERFECT)",
                             remedy="give it sensors, or use the true state")
        reading = self._sensor_model.read(self.k, max(1, self._passed), self._history, self._bias,
                                      going, self._sensor_effects)
        self._passed = 0
        return reading

    def _extrapolate_past(self, state: Sequence[Value]) -> Callable[[int], Sequence[Value]]:
        """Make the signals k steps before a start, extrapolated with constant velocities."""
        f = self.ops.f
        dt = self.config.step
        x, y, yaw, u, v, r = state[:6]
        vx = u * f.cos(yaw) - v * f.sin(yaw)
        vy = u * f.sin(yaw) + v * f.cos(yaw)
        speed = f.fabs(u)

        def rows(k: int) -> Sequence[Value]:
            t = k * dt
            row = (-t * u, -t * speed, u, r, -r * v, r * u, x - t * vx, y - t * vy, yaw - t * r)
            return row if self._signals == SIGNAL_COUNTS[0] else (*row, v, 0.0 * v, 0.0 * v)

        return rows
