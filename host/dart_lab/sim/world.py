"""The virtual world: closes the loop from the PWM pins to the sensor pins.

Pulses of the PCA9685 model drive servo and ESC, these move the car, and its motion is the input
of the Nano's encoder and IMU. One tick is 1 ms of world time. The Nano stops at every frame
delimiter, so that a host can react to a frame at the time of its last stop bit.
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
from dart_lab.sim.battery import SimBattery, SimDivider
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.cutoff import INPUT_FILTER, make_wiring
from dart_lab.sim.esc import DelayedEsc, Esc
from dart_lab.sim.faults import Line
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.imu import Imu
from dart_lab.sim.injected import ServoWithEffects, make_signal_effects
from dart_lab.sim.motion import DynamicMotion, KinematicMotion, MeanMotion, MotionModel
from dart_lab.sim.nano import Nano
from dart_lab.sim.pca9685 import Pca9685Model
from dart_lab.sim.pwm_output import Pulse
from dart_lab.sim.rc import PinInput, SimReceiver
from dart_lab.sim.servo import SteeringServo
from dart_lab.sim.stand import LiftedCar

# Channels of the PCA9685. The spare one is wired to the Nano's input capture.
STEERING_CHANNEL = 0
THROTTLE_CHANNEL = 1
CLOCK_CHANNEL = 15

# Tick of the world [s].
TICK = 1e-3
_MODELS: dict[str, Callable[[Vehicle, float], MotionModel]] = {
    "dynamic": DynamicMotion, "kinematic": KinematicMotion}
# Brake force of a blocked wheel [N].
BLOCKING_FORCE = 20.0
# Smallest speed of the tread at which a person sees which way a wheel turns [m/s].
MIN_VISIBLE_SPEED = 0.05
_AT_REST = MeanMotion(0.0, 0.0, 0.0, 0.0, 0.0)
# Fields of `Truth` without t. A state is recorded every 5 ticks; of more than a million states
# (83 minutes) the older half is dropped.
_ROW_LENGTH = 8
_TICKS_PER_RECORD = 5
_MAX_RECORDS = 1_000_000


@dataclass(frozen=True, slots=True)
class Truth:
    """True state of the car at time t [s]: pose of the rear axle [m, rad], speeds, road wheels.

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

    ``trail``: called every 5 ms with t [s] and x, y [m], yaw [rad] of the rear axle;
    ``wheel_direction``: last direction of the wheels, 1 forward, -1 backward, 0 before the first
    motion; ``receiver``: of an RC transmitter, or None; ``battery``: one that is measured, or None;
    ``divider``: of the battery at the Nano, or None; ``blocked``: a wheel is blocked; ``lifted``:
    the car with its wheels off the ground, or None; ``can_be_lifted`` False: ``lift`` has no
    effect; ``hand_rate`` [rad/s]: a hand turns the car on the spot, 0 for none. Effects are part of
    ``car``, see ``dart_lab.sim.true_car``.
    """

    def __init__(self, car: HiddenCar, nano: Nano, model: str = "dynamic",
                 tick: float = TICK, cutoff: str = "none") -> None:
        if model not in _MODELS:
            raise UsageError(f"no model {model!r}", expected=", ".join(_MODELS))
        self.t = 0.0
        self.car = car
        self.nano = nano
        self.pca = Pca9685Model(oscillator=car.oscillator_hz)
        self.bus = VirtualBus(lambda: self.t, [self.pca])
        rest = np.random.default_rng([car.seed, 101])
        self._signal_effects = effects = make_signal_effects(car, tick)
        self.servo = SteeringServo(car.servo, rest) if effects is None else ServoWithEffects(
            car.servo, rest, car.vehicle, tick, lambda: effects.now)
        self.esc = DelayedEsc(car.esc) if car.esc.delay else Esc(car.esc)
        self.motion: MotionModel = _MODELS[model](car.vehicle, tick)
        self._wiring = make_wiring(cutoff, self.pca)
        self.lifted: LiftedCar | None = None
        self.can_be_lifted = self.esc_powered = True
        self.blocked = False
        self.hand_rate = 0.0
        self.wheel_direction = 0
        nano.gate_capture(self._wiring.capture_gate)
        self.distance = 0.0
        self.lines: tuple[Line, ...] = ()
        self.watchers: list[Callable[[int, Pulse], None]] = []
        self.trail: Callable[[float, float, float, float], None] | None = None
        self._agenda: list[tuple[float, int, Callable[[World], None]]] = []
        self.receiver: SimReceiver | None = None
        self.battery: SimBattery | None = None
        self.divider: SimDivider | None = None
        self._pin_edges: list[PinInput] = []
        self._imu = Imu(car.imu, car.vehicle.body.l_r, tick,
                        np.random.default_rng([car.seed, 100]))
        self._dt = tick
        self._tick = 0
        self._next = 0.0
        self._wheel = 0.0
        self._per_revolution = 1.0 / car.gear_revolution
        self._times = array("d")
        self._rows = array("d")
        nano.set_ring(0, car.ring_a.edges)
        nano.set_ring(1, car.ring_b.edges)

    def advance(self, until: float) -> bool:
        """Run to ``until`` [s], or to the end of the next frame; True = a frame has just ended."""
        nano = self.nano
        while self.t < until:
            if self.t >= self._next:
                self._step_physics()
            pin = self._pin_edges
            target = min(until, pin[0][0] if pin else self._next)
            early = nano.run(target)
            self.t = nano.now
            if pin and not early and target == pin[0][0]:
                nano.set_pin(*pin.pop(0)[1:])
            if early:
                return True
        return False

    def schedule(self, t: float, action: Callable[[World], None]) -> None:
        """Call ``action(world)`` at the first tick from world time t on."""
        insort(self._agenda, (t, len(self._agenda), action), key=lambda entry: entry[:2])

    def power_nano(self, on: bool) -> None:
        """Connect or disconnect the Nano's USB cable, with its supply and its ground."""
        self.nano.set_power(on)
        self._wiring.set_power(on, self.t)

    def lift(self) -> None:
        """Lift the car: its body is at rest, its wheels turn freely."""
        if self.lifted is None and self.can_be_lifted:
            self.lifted = LiftedCar(self.car, self.motion.drive, self._dt, self.motion.v_x)
            self.motion.v_x = self.motion.v_y = self.motion.omega = 0.0

    def set_down(self) -> None:
        """Put the car back on the floor, at rest."""
        self.lifted = None

    def truth(self, t: float | None = None) -> Truth:
        """Return the true state at time t [s], default now; linear between records 5 ms apart."""
        self._record(self._next)
        when = self.t if t is None else t
        k = min(max(bisect_right(self._times, when), 1), len(self._times) - 1)
        if len(self._times) == 1:
            return Truth(self._times[0], *self._rows)
        t0 = self._times[k - 1]
        t1 = self._times[k]
        part = min(1.0, max(0.0, (when - t0) / (t1 - t0))) if t1 > t0 else 1.0
        a = self._rows[_ROW_LENGTH * (k - 1):_ROW_LENGTH * k]
        b = self._rows[_ROW_LENGTH * k:_ROW_LENGTH * (k + 1)]
        return Truth(when, *(p + part * (q - p) for p, q in zip(a, b, strict=True)))

    def poses(self, times: FloatArray) -> FloatArray:
        """Return x, y [m], yaw [rad] (n, 3) of the rear axle at increasing times (n,) [s]."""
        self._record(self._next)
        k = max(bisect_right(self._times, times[0]) - 1, 0)
        t = np.array(self._times[k:])
        rows = np.array(self._rows[_ROW_LENGTH * k:]).reshape(-1, _ROW_LENGTH)
        return np.column_stack([np.interp(times, t, rows[:, i]) for i in range(3)])

    def _step_physics(self) -> None:
        """Compute one tick: pins, actuators, motion, sensors.

        1. Run the actions that are due and deliver the pulses that have ended.
        2. Move the servo and update the ESC; failures and effects change their outputs.
        3. Integrate the motion over the tick, of the car on the floor or of its free wheels.
        4. Set the inputs of encoder, IMU and input capture until the next tick.
        """
        now = self._next
        while self._agenda and self._agenda[0][0] <= now:
            self._agenda.pop(0)[2](self)
        if now >= self.pca.output.quiet_until or self._wiring.needs_ticks:
            self._deliver_pulses(now)
        if self._tick % _TICKS_PER_RECORD == 0:
            self._record(now)
        self._tick += 1
        self._next = self._tick * self._dt
        esc = self.esc
        nano = self.nano
        esc.check(now)
        angle = self.servo.move(now, self._dt)
        effects = self._signal_effects
        throttle = esc.throttle
        brake = esc.brake * self.car.brake_force
        if not self.esc_powered:
            throttle = brake = 0.0
        if self.blocked:
            throttle = 0.0
            brake = BLOCKING_FORCE
        if effects is not None:
            throttle = effects.throttle(now, throttle,
                                        None if self.battery is None else self.battery.voltage)
        lifted = self.lifted
        if self.hand_rate:
            mean = MeanMotion(0.0, 0.0, 0.0, self.hand_rate, 0.0)
            self.motion.eta += self.hand_rate * self._dt
        elif lifted is not None:
            mean = _AT_REST
        else:
            mean = self.motion.step(throttle, brake, angle)
        speed, a_x, a_y, omega, omega_dot = mean
        self.distance += speed * self._dt
        rate = omega
        if effects is not None:
            speed, rate, a_x, a_y = effects.sensor_inputs(mean, self.motion, throttle, brake)
        if lifted is not None:
            speed = lifted.step(throttle, brake)
        if abs(speed) > MIN_VISIBLE_SPEED:
            self.wheel_direction = 1 if speed > 0.0 else -1
        wheel = speed * self._per_revolution
        if wheel != self._wheel:
            self._wheel = wheel
            nano.set_wheel(wheel)
        nano.set_imu(*self._imu.sense(a_x, a_y, omega, omega_dot, rate))
        self._pin_edges = [(t, "D8", level) for t, level in self._capture_edges()]
        if self.receiver is not None:
            self._pin_edges = sorted([*self._pin_edges, *self.receiver.edges(now, self._next)])

    def _capture_edges(self) -> list[tuple[float, bool]]:
        """Return the edges of the spare channel until the next tick, before the cut-off."""
        return self.pca.output.upcoming(CLOCK_CHANNEL, self._next)

    def _deliver_pulses(self, now: float) -> None:
        output = self.pca.output
        wiring = self._wiring
        if wiring.needs_ticks:
            wiring.apply_pin_edges(self.nano.pin_log())
        output.advance(now)
        self._deliver(STEERING_CHANNEL, output.take(STEERING_CHANNEL), self.servo.pulse)
        self._deliver(THROTTLE_CHANNEL, wiring.esc_pulses(THROTTLE_CHANNEL, now), self.esc.pulse)
        output.take(CLOCK_CHANNEL)

    def _deliver(self, channel: int, pulses: list[Pulse],
                 receive: Callable[[Pulse], None]) -> None:
        for pulse in pulses:
            if pulse[1] - pulse[0] < INPUT_FILTER:
                continue
            receive(pulse)
            for watcher in self.watchers:
                watcher(channel, pulse)

    def _record(self, t: float) -> None:
        if self._times and t <= self._times[-1]:
            return
        m = self.motion
        l_r = self.car.vehicle.body.l_r
        c = math.cos(m.eta)
        s = math.sin(m.eta)
        x = m.x - l_r * c
        y = m.y - l_r * s
        self._times.append(t)
        self._rows.extend((x, y, m.eta, m.v_x, m.v_y, m.omega, self.servo.angle, self.distance))
        if self.trail is not None:
            self.trail(t, x, y, m.eta)
        if len(self._times) > _MAX_RECORDS:
            # The row of a record starts at _ROW_LENGTH times its index.
            del self._times[:_MAX_RECORDS // 2], self._rows[:_ROW_LENGTH * (_MAX_RECORDS // 2)]
