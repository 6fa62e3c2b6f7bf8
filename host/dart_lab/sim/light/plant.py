"""Command to reading, without firmware: what ``LightCar`` and ``LightBatch`` share.

One step: commands into the queue, actuators and bicycle (``vehicle.make_car_step``),
the disturbance as a kick to the velocities, signals into the history.
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
from dart_lab.sim.light.chain import make_shaping, make_slew, pieces
from dart_lab.sim.light.config import PERFECT, LightConfig
from dart_lab.sim.light.effects import (
    SENSORS,
    Acting,
    Measured,
    Memory,
    acts,
    check,
    lateness,
    measures,
    motion_of,
    without_null,
)
from dart_lab.sim.light.force import Kicker
from dart_lab.sim.light.history import History
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.sense import SIGNALS, Reading, Readings, depth_of
from dart_lab.sim.light.stepper import Fineness, State8, Stepper, fineness

MakeStepper = Callable[..., Stepper]
"""``make(vehicle, duration, method, fineness, kind="car")``, see ``stepper``."""
Move = Callable[[State8, Value, Value], State8]


class Plant:
    """State and past of one car or of a batch; the values are floats or arrays."""

    def __init__(self, vehicle: Vehicle, config: LightConfig, ops: Ops,
                 make_stepper: MakeStepper, seeds: Sequence[noise.Seed], scalar: bool,
                 nominal: Vehicle) -> None:
        self.config, self.ops, self._scalar = config, ops, scalar
        self._make_stepper, self._nominal = make_stepper, apply_parameter_effects(nominal)
        self.state: State8 = ()
        self.k: Value = 0
        self._shape = make_shaping(config.actuators, ops)
        self._slew = make_slew(config.actuators.steering_rate, ops)
        self._limited = config.actuators.steering_rate < 100.0 / config.step
        delay = self._nominal.delay
        self._pieces = pieces(config.step, delay.throttle_s, delay.steering_s)
        self._queue: deque[tuple[Value, Value]] = deque(
            maxlen=1 + max(max(p.throttle, p.steering) for p in self._pieces))
        self._servo: Value = 0.0
        self._kick = (Kicker(config.disturbance, vehicle.body.mass, config.step)
                      if config.disturbance.acts else None)
        self._past: History | None = None
        self._memory: Memory = {}
        self._depth, self._signals = self._room(vehicle, 2.0)
        self._travel: Value = 0.0
        self._path: Value = 0.0
        self._bias: Any = (0.0, 0.0, 0.0)
        self._passed = 0
        self._ticks: Value = 0
        self.set_vehicle(vehicle)
        self.seed(seeds)

    def set_vehicle(self, vehicle: Vehicle) -> None:
        """Go on with other parameters; pure delays stay those of the first vehicle.

        Here, and nowhere else, a parameter set becomes equations. Raises
        UsageError for an effect that would need the future, or a longer memory
        than that of the first vehicle.
        """
        c, p = self.config, without_null(apply_parameter_effects(vehicle))
        check(p, c.sensors)
        depth, seen = self._room(vehicle)
        if depth > self._depth or seen > self._signals:
            raise UsageError("the sensors do not look back so far",
                             found="an effect on readings that the first vehicle had not, or "
                                   "more than twice as late", expected="the effects of the first",
                             remedy="make another car for this vehicle")
        self.vehicle = vehicle
        self._acting: list[Acting] = []
        self._steppers = tuple(
            (piece, self._mover(p, piece.duration,
                                fineness(vehicle, piece.duration, c.method)))
            for piece in self._pieces)
        self._measured = Measured(p, c.step, self.ops) if measures(p) else None
        self._drive = make_drive(p.motor, p.friction, self.ops.f)
        if self._kick is not None:
            self._kick.set_mass(p.body.mass)

    def _mover(self, p: Vehicle, duration: float, fine: Fineness) -> Move:
        method = self.config.method
        moving = motion_of(p)
        if not acts(p):
            return self._make_stepper(moving, duration, method, fine)
        motion = self._make_stepper(moving, duration, method, fine, "motion")
        acting = Acting(p, duration, self.ops, self._memory, motion)
        self._acting.append(acting)

        def move(state: State8, throttle: Value, steering: Value) -> State8:
            return acting.step(state, throttle, steering, self._now(state))

        return move

    def _now(self, state: Sequence[Value]) -> Now:
        """What an effect on a command may know."""
        return Now(self._ticks * self.config.step, state[3], state[4], state[5], state[2])

    def _room(self, vehicle: Vehicle, growth: float = 1.0) -> tuple[int, int]:
        """(steps, signals) that the history needs when latencies grow by a factor."""
        c, p = self.config, without_null(apply_parameter_effects(vehicle))
        if c.sensors is None or not measures(p):
            return (0 if c.sensors is None else depth_of(c.sensors, c.step)), SIGNALS[0]
        late = [growth * np.maximum(lateness(p, channel), 0.0) for channel in SENSORS]
        return depth_of(c.sensors, c.step, late), SIGNALS[1]

    def _begin(self, which: Any) -> None:
        """Effects with a memory begin anew for some cars: True, or an array of bool."""
        self._ticks = self.k
        for acting in self._acting[:1]:             # the pieces of a step share one memory
            acting.start(self.state, self._now(self.state), which)

    def seed(self, seeds: Sequence[noise.Seed]) -> None:
        """Begin all noise anew, one seed for each car."""
        c = self.config

        def draw(stream: int, columns: int) -> Any:
            return noise.streams(seeds, stream, columns, self._scalar, c.dtype)

        self._forces = draw(noise.FORCE, 2) if self._kick else None
        self._starts = [noise.generator(seed, noise.START) for seed in seeds]
        self._passed = 0
        self._readings = (None if c.sensors is None else
                          Readings(c.sensors, c.step, self._nominal.body.l_r, self.ops, draw))

    def advance(self, throttle: Value, steering: Value, steps: int = 1) -> State8:
        """State after ``steps`` steps with commands -1..1 held."""
        command = self._shape(throttle, steering)
        for i in range(steps):
            self._ticks = self.k + i
            self._queue.appendleft(command)
            old = self.state
            self._move()
            if self._past is not None:
                self._remember(old, self._past)
        self.k = self.k + steps
        self._passed += steps
        return self.state

    def _move(self) -> None:
        queue, state = self._queue, self.state
        for piece, stepper in self._steppers:
            s = queue[piece.steering][1]
            if self._limited:
                self._servo, s = self._slew(self._servo, s, piece.duration)
            state = stepper(state, queue[piece.throttle][0], s)
        if self._kick is not None and self._forces is not None:
            state = self._kick(state, self._forces.row())
        self.state = state

    def _remember(self, old: State8, past: History) -> None:
        """Signals at the end of the step; accelerations are means over it."""
        dt, f = self.config.step, self.ops.f
        _, _, _, u0, v0, r0, _, _ = old
        x, y, yaw, u, v, r, _, _ = self.state
        self._travel = self._travel + 0.5 * dt * (u0 + u)
        self._path = self._path + 0.5 * dt * (f.fabs(u0) + f.fabs(u))
        turn = 0.25 * (r0 + r)
        seen: tuple[Value, ...] = (
            self._travel, self._path, u, r, (u - u0) / dt - turn * (v0 + v),
            (v - v0) / dt + turn * (u0 + u), x, y, yaw)
        if self._signals > SIGNALS[0]:
            throttle = self._acting[-1].throttle if self._acting else self.state[6]
            seen = (*seen, v, (r - r0) / dt, self._drive(throttle, u))
        past.push(seen)

    def skip(self, steps: int) -> None:
        """Use up the disturbance of ``steps`` steps, as a car that was driven would have."""
        if self._forces is not None:
            for _ in range(steps):
                self._forces.row()

    def _offsets(self, row: Sequence[Value]) -> tuple[Value, Value, Value]:
        """Biases of gyro and accelerometer from three standard normal numbers."""
        s = self.config.sensors or PERFECT
        return (s.gyro.offset_spread * row[0], s.accel.offset_spread * row[1],
                s.accel.offset_spread * row[2])

    def read(self, going: Any = True) -> Reading:
        """What the sensors say now. Raises UsageError for bare physics."""
        if self._readings is None or self._past is None:
            raise UsageError("this light car has no sensors", found="LightConfig(sensors=None)",
                             expected="LightConfig(sensors=PERFECT)",
                             remedy="give it sensors, or take the true state")
        reading = self._readings.read(self.k, max(1, self._passed), self._past, self._bias, going,
                                      self._measured)
        self._passed = 0
        return reading

    def _before(self, state: Sequence[Value]) -> Callable[[int], Sequence[Value]]:
        """Signals k steps before a start: the car is taken to have come at steady speed."""
        f, dt = self.ops.f, self.config.step
        x, y, yaw, u, v, r = state[:6]
        vx, vy = u * f.cos(yaw) - v * f.sin(yaw), u * f.sin(yaw) + v * f.cos(yaw)
        speed = f.fabs(u)

        def rows(k: int) -> Sequence[Value]:
            t = k * dt
            seen = (-t * u, -t * speed, u, r, -r * v, r * u, x - t * vx, y - t * vy, yaw - t * r)
            return seen if self._signals == SIGNALS[0] else (*seen, v, 0.0 * v, 0.0 * v)

        return rows
