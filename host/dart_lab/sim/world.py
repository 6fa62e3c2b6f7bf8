"""The virtual world: closes the loop from the PWM pins to the sensor pins.

Pulses of the PCA9685 model move servo and ESC, these move the car, and the
car turns the encoder ring and shakes the IMU of a Nano. One tick is 1 ms of
world time; the Nano stops at every frame delimiter, so that a host reacts to
a frame at the very time of its last stop bit.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right, insort
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle import Vehicle
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.cutoff import Multiplexer, make_wiring
from dart_lab.sim.esc import Esc, LateEsc
from dart_lab.sim.faults import Line
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.imu import Imu
from dart_lab.sim.injected import InjectedServo, injected
from dart_lab.sim.motion import DynamicMotion, Felt, KinematicMotion, Motion
from dart_lab.sim.nano import Nano
from dart_lab.sim.pca9685 import Pca9685
from dart_lab.sim.pwm_output import Pulse
from dart_lab.sim.servo import Servo
from dart_lab.sim.stand import Stand

STEERING, THROTTLE, CLOCK = 0, 1, 15
"""Channels of the PCA9685; the spare one is wired to the Nano's input capture."""

TICK = 1e-3
_MODELS: dict[str, Callable[[Vehicle, float], Motion]] = {
    "dynamic": DynamicMotion, "kinematic": KinematicMotion}
BLOCK = 20.0
"""N by which a blocked wheel holds the car."""
SEEN = 0.05
"""m/s of the tread that nobody overlooks."""
_STANDS = Felt(0.0, 0.0, 0.0, 0.0, 0.0)
_ROW = 8
_EVERY = 5
_KEEP = 1_000_000


@dataclass(frozen=True, slots=True)
class Truth:
    """What the car really does at time t: rear axle [m], yaw [rad], speeds, wheels.

    v_x, v_y [m/s] of the centre of mass in body axes, yaw_rate [rad/s],
    steering = road-wheel angle [rad], distance = path of v_x [m].
    """

    t: float
    x: float
    y: float
    yaw: float
    v_x: float
    v_y: float
    yaw_rate: float
    steering: float
    distance: float


class World:
    """One simulated car with its Nano; ``t`` is the world time reached [s].

    ``trail``: called with t [s], x, y [m], yaw [rad] of the rear axle each 5 ms;
    ``turned``: which way the wheels turned last, 1 forward, -1 backward; ``blocked``: something
    holds a wheel; ``stand_holds`` False: a car that was lifted stands on the floor all the same.
    Effects act through ``car``, see ``dart_lab.sim.true_car``.
    """

    def __init__(self, car: HiddenCar, nano: Nano, model: str = "dynamic",
                 tick: float = TICK, cutoff: str = "none") -> None:
        if model not in _MODELS:
            raise UsageError(f"no model {model!r}", expected=", ".join(_MODELS))
        self.t = 0.0
        self.car, self.nano = car, nano
        self.pca = Pca9685(oscillator=car.oscillator_hz)
        self.bus = VirtualBus(lambda: self.t, [self.pca])
        rest = np.random.default_rng([car.seed, 101])
        self._injected = effects = injected(car, tick)
        self.servo = Servo(car.servo, rest) if effects is None else InjectedServo(
            car.servo, rest, car.vehicle, tick, lambda: effects.now)
        self.esc = LateEsc(car.esc) if car.esc.delay else Esc(car.esc)
        self.motion: Motion = _MODELS[model](car.vehicle, tick)
        self._wiring = make_wiring(cutoff, self.pca)
        self._through = True
        self.stand: Stand | None = None
        self.stand_holds = self.esc_powered = True
        self.blocked = False
        self.turned = 0
        nano.capture_behind_mux(isinstance(self._wiring, Multiplexer))
        self.distance = 0.0
        self.lines: tuple[Line, ...] = ()
        self.watchers: list[Callable[[int, Pulse], None]] = []
        self.trail: Callable[[float, float, float, float], None] | None = None
        self._agenda: list[tuple[float, int, Callable[[World], None]]] = []
        self._pin_edges: list[tuple[float, bool]] = []
        self._imu = Imu(car.imu, car.vehicle.body.l_r, tick,
                        np.random.default_rng([car.seed, 100]))
        self._dt, self._tick, self._next = tick, 0, 0.0
        self._wheel = 0.0
        self._per_revolution = 1.0 / car.gear_revolution
        self._times, self._rows = array("d"), array("d")
        nano.set_ring(0, car.ring_a.edges)
        nano.set_ring(1, car.ring_b.edges)

    def advance(self, until: float) -> bool:
        """Run towards ``until``; True = stopped early, a frame has just ended."""
        nano = self.nano
        while self.t < until:
            if self.t >= self._next:
                self._physics()
            pin = self._pin_edges
            target = min(until, pin[0][0] if pin else self._next)
            early = nano.run(target)
            self.t = nano.now
            if pin and not early and target == pin[0][0]:
                nano.set_pin("D8", pin.pop(0)[1])
            if early:
                return True
        return False

    def at(self, t: float, action: Callable[[World], None]) -> None:
        """Call ``action(world)`` at the first tick from world time t on."""
        insort(self._agenda, (t, len(self._agenda), action), key=lambda entry: entry[:2])

    def power_nano(self, on: bool) -> None:
        """The Nano's USB cable goes in or out: without it, no supply and no ground from there."""
        self.nano.set_power(on)
        self._wiring.power(on, self.t)

    def lift(self) -> None:
        """The car goes on a stand: its body rests, its wheels turn freely."""
        if self.stand is None and self.stand_holds:
            self.stand = Stand(self.car, self.motion.drive, self._dt, self.motion.v_x)
            self.motion.v_x = self.motion.v_y = self.motion.omega = 0.0

    def set_down(self) -> None:
        """The car is back on the floor, at rest."""
        self.stand = None

    def truth(self, t: float | None = None) -> Truth:
        """The state at time t (linear between records 5 ms apart), default now."""
        self._record(self._next)
        when = self.t if t is None else t
        k = min(max(bisect_right(self._times, when), 1), len(self._times) - 1)
        if len(self._times) == 1:
            return Truth(self._times[0], *self._rows)
        t0, t1 = self._times[k - 1], self._times[k]
        part = min(1.0, max(0.0, (when - t0) / (t1 - t0))) if t1 > t0 else 1.0
        a, b = self._rows[_ROW * (k - 1):_ROW * k], self._rows[_ROW * k:_ROW * (k + 1)]
        return Truth(when, *(p + part * (q - p) for p, q in zip(a, b, strict=True)))

    def poses(self, times: FloatArray) -> FloatArray:
        """x, y [m], yaw [rad] (n, 3) of the rear axle at rising times (n,) [s], as ``truth``."""
        self._record(self._next)
        k = max(bisect_right(self._times, times[0]) - 1, 0)
        at, rows = np.array(self._times[k:]), np.array(self._rows[_ROW * k:]).reshape(-1, _ROW)
        return np.column_stack([np.interp(times, at, rows[:, i]) for i in range(3)])

    def _physics(self) -> None:
        """State of the pins now, motion until the next tick, what the sensors see."""
        now = self._next
        while self._agenda and self._agenda[0][0] <= now:
            self._agenda.pop(0)[2](self)
        if now >= self.pca.output.quiet_until or self._wiring.live:
            self._pulses(now)
        if self._tick % _EVERY == 0:
            self._record(now)
        self._tick += 1
        self._next = self._tick * self._dt
        esc, nano = self.esc, self.nano
        esc.check(now)
        angle = self.servo.move(now, self._dt)
        effects, throttle, brake = self._injected, esc.throttle, esc.brake * self.car.brake_force
        if not self.esc_powered:
            throttle = brake = 0.0
        if self.blocked:  # what holds the wheel takes whatever the motor pulls
            throttle, brake = 0.0, BLOCK
        if effects is not None:
            throttle = effects.throttle(now, throttle)
        stand = self.stand
        felt = _STANDS if stand is not None else self.motion.step(throttle, brake, angle)
        speed, a_x, a_y, omega, omega_dot = felt
        self.distance += speed * self._dt
        rate = omega
        if effects is not None:
            speed, rate, a_x, a_y = effects.sensed(felt, self.motion, throttle, brake)
        if stand is not None:
            speed = stand.step(throttle, brake)
        if abs(speed) > SEEN:
            self.turned = 1 if speed > 0.0 else -1
        wheel = speed * self._per_revolution
        if wheel != self._wheel:
            self._wheel = wheel
            nano.set_wheel(wheel)
        nano.set_imu(*self._imu.sense(a_x, a_y, omega, omega_dot, rate))
        self._pin_edges = self._capture_edges(now)

    def _capture_edges(self, now: float) -> list[tuple[float, bool]]:
        """What D8 gets until the next tick: the spare channel, behind the cut-off.

        A gate on /OE acts here at the tick that follows, a multiplexer at once:
        the Nano itself knows its select.
        """
        output, through = self.pca.output, self._wiring.captured
        edges = output.upcoming(CLOCK, self._next) if through else []
        if through != self._through:
            self._through = through
            edges.insert(0, (now, through and output.high_since(CLOCK) is not None))
        return edges

    def _pulses(self, now: float) -> None:
        output, wiring = self.pca.output, self._wiring
        if wiring.live:
            wiring.pins(self.nano.pin_log())
        output.advance(now)
        self._deliver(STEERING, output.take(STEERING), self.servo.pulse)
        self._deliver(THROTTLE, wiring.esc_pulses(THROTTLE, now), self.esc.pulse)
        output.take(CLOCK)

    def _deliver(self, channel: int, pulses: list[Pulse], to: Callable[[Pulse], None]) -> None:
        for pulse in pulses:
            to(pulse)
            for watcher in self.watchers:
                watcher(channel, pulse)

    def _record(self, t: float) -> None:
        if self._times and t <= self._times[-1]:
            return
        m, l_r = self.motion, self.car.vehicle.body.l_r
        c, s = math.cos(m.eta), math.sin(m.eta)
        x, y = m.x - l_r * c, m.y - l_r * s
        self._times.append(t)
        self._rows.extend((x, y, m.eta, m.v_x, m.v_y, m.omega, self.servo.angle, self.distance))
        if self.trail is not None:
            self.trail(t, x, y, m.eta)
        if len(self._times) > _KEEP:
            del self._times[:_KEEP // 2], self._rows[:_ROW * (_KEEP // 2)]
