"""Command to reading, without firmware: what ``LightCar`` and ``LightBatch`` share.

One step: commands into the queue, actuators and bicycle (``vehicle.make_car_step``),
the disturbance as a kick to the velocities, signals into the history.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from dart_hal.errors import UsageError
from dart_hal.sim.light import noise
from dart_hal.sim.light.chain import make_shaping, make_slew, pieces
from dart_hal.sim.light.config import PERFECT, LightConfig
from dart_hal.sim.light.force import Kicker
from dart_hal.sim.light.history import History
from dart_hal.sim.light.ops import Ops
from dart_hal.sim.light.sense import Reading, Readings
from dart_hal.sim.light.stepper import Fineness, State8, Stepper, fineness
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.namespace import Value

MakeStepper = Callable[[Vehicle, float, str, Fineness], Stepper]


class Plant:
    """State and past of one car or of a batch; the values are floats or arrays."""

    def __init__(self, vehicle: Vehicle, config: LightConfig, ops: Ops,
                 make_stepper: MakeStepper, seeds: Sequence[noise.Seed], scalar: bool,
                 nominal: Vehicle) -> None:
        self.config, self.ops, self._scalar = config, ops, scalar
        self._make_stepper, self._nominal = make_stepper, settled(nominal)
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
        self._travel: Value = 0.0
        self._path: Value = 0.0
        self._bias: Any = (0.0, 0.0, 0.0)
        self._passed = 0
        self.set_vehicle(vehicle)
        self.seed(seeds)

    def set_vehicle(self, vehicle: Vehicle) -> None:
        """Go on with other parameters; pure delays stay those of the first vehicle.

        Here, and nowhere else, a parameter set becomes equations. Raises
        UsageError for an effect that this path would leave out.
        """
        left_out = [a.name for a in vehicle.effects if a.effect.signals]
        if left_out:
            raise UsageError("the light simulation has no effects on signals",
                             found=", ".join(left_out),
                             expected="effects on parameters and forces",
                             remedy="use the sensors and actuators of LightConfig")
        self.vehicle = vehicle
        c = self.config
        self._steppers = tuple(
            (piece, self._make_stepper(vehicle, piece.duration, c.method,
                                       fineness(vehicle, piece.duration, c.method)))
            for piece in self._pieces)
        if self._kick is not None:
            self._kick.set_mass(settled(vehicle).body.mass)

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
        for _ in range(steps):
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
        past.push((self._travel, self._path, u, r, (u - u0) / dt - turn * (v0 + v),
                   (v - v0) / dt + turn * (u0 + u), x, y, yaw))

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
        reading = self._readings.read(self.k, max(1, self._passed), self._past, self._bias, going)
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
            return (-t * u, -t * speed, u, r, -r * v, r * u, x - t * vx, y - t * vy, yaw - t * r)

        return rows
