"""Drive a Car with constant pulses, frame by frame, and detect faults.

Each STATE frame is answered by one pair of pulses: the telemetry is the clock. The throttle comes
from the speed law or is constant; the steering pulse is constant.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dart_hal.control.speed import SpeedLaw
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BadCommand, CalibrationFailed
from dart_hal.core.types import Applied, Doubt, State
from dart_hal.vehicle.sets import PAPER

if TYPE_CHECKING:
    from dart_hal.car import Car

# 1/(m/s), lower than when driving. An uncalibrated ring makes the measured speed ripple once a
# turn, and the response of the loop would move the wheels.
CALIBRATION_K_P = 0.2
# Slow circles need 0.25; more means that the speed is not measured.
CALIBRATION_MAX_THROTTLE = 0.4
# s of throttle without motion until the procedure gives up.
MAX_STANDSTILL = 4.0
# rad/s at full lock: a tenth of what 0.35 m/s gives.
MIN_TURN_RATE = 0.12


class NoMotion(CalibrationFailed):
    """The encoder does not measure the motion that the throttle should cause."""


class DrivableCar(Protocol):
    """The part of a Car that the runner uses."""

    files: CarFiles

    def states(self, *, duration: float = ..., timeout: float = ...) -> Iterator[State]: ...
    def pulses(self, *, steering_us: float, throttle_us: float) -> Applied: ...
    def stop(self) -> object: ...
    def refusals(self) -> tuple[str, ...]: ...


class CalibrationRunner:
    """Hold pulses and speeds for given times of the car's clock; use inside ``car.raw()``."""

    def __init__(self, car: DrivableCar) -> None:
        files = car.files
        self._car = car
        # Beyond the limit of the car, which clips the pulse, the integral would wind up.
        self._law = SpeedLaw(PAPER, k_p=CALIBRATION_K_P,
                             max_throttle=min(CALIBRATION_MAX_THROTTLE,
                                              files.config.limits.max_throttle))
        self._neutral = files.neutral_us
        self._span = files.config.throttle.span_us
        self._last: float | None = None
        self._frames = iter(car.states())

    def hold(self, seconds: float, steering_us: float, speed: float,
             throttle_us: float | None = None) -> list[State]:
        """Hold a steering pulse and a speed [m/s] (0 = standstill); return the States.

        seconds: of the car's clock. throttle_us: constant throttle pulse instead of the speed loop.
        Raises NoMotion when the speed becomes doubtful, CalibrationFailed if the car speeds up
        against its throttle, BadCommand when another trip ended ``raw()``, LinkLost and other
        errors of the Car.
        """
        states: list[State] = []
        start: float | None = None
        for state in self._frames:
            dt = 0.0 if self._last is None else min(state.t - self._last, 0.1)
            self._last = state.t
            start = state.t if start is None else start
            states.append(state)
            if state.health.speed_doubted:
                raise encoder_doubt(state)
            throttle = self._law.throttle(speed, state.speed, dt)
            pulse = self._neutral + self._span * throttle if throttle_us is None else throttle_us
            try:
                self._car.pulses(steering_us=steering_us, throttle_us=pulse)
            except BadCommand as error:
                if "AGAINST_THROTTLE" in error.causes:
                    raise backward_error(f"{state.speed:+.2f} m/s, faster and faster") from error
                raise
            if state.t - start >= seconds:
                break
        return states

    def start_moving(self, steering_us: float, speed: float, bias: float,
                     left: bool) -> list[State]:
        """Accelerate to ``speed`` [m/s] at a steering lock; left: expected direction.

        bias [rad/s]: of the yaw rate. Raises CalibrationFailed with the likely cause if car,
        encoder or gyro do not respond as expected.
        """
        states: list[State] = []
        while True:
            states += self.hold(0.5, steering_us, speed)
            if check_pull(states, speed, bias) and states[-1].t - states[0].t > 2.0:
                break
        check_turning(states[-40:], bias, left)
        return states


@contextmanager
def driving(car: Car) -> Iterator[CalibrationRunner]:
    """Run the block in raw mode; stop the car at its end, also on Ctrl-C."""
    try:
        with car.raw():
            yield CalibrationRunner(car)
    finally:
        car.stop()


def check_pull(states: list[State], speed: float, bias: float = 0.0) -> bool:
    """Return whether the car has reached ``speed`` [m/s].

    states: since the first frame of throttle. bias [rad/s]: of the yaw rate. Raises
    CalibrationFailed if it takes too long.
    """
    now = float(np.mean([s.speed for s in states[-40:]]))
    if now > 0.8 * speed:
        return True
    waited = states[-1].t - states[0].t
    if waited > MAX_STANDSTILL and states[-1].ticks == states[0].ticks:
        raise _no_ticks(states, bias)
    if waited > 3.0 * MAX_STANDSTILL:
        raise CalibrationFailed(
            f"the car does not reach {speed} m/s", found=f"{now:.2f} m/s",
            expected=f"{speed} m/s at a throttle of at most {CALIBRATION_MAX_THROTTLE}",
            likely="battery low, brake on, or a neutral pulse that is far off",
            remedy="charge the battery; dart-hal doctor")
    return False


def yaw_rates(states: list[State]) -> list[float]:
    """Yaw rates [rad/s] of the States with a valid sample of the IMU."""
    return [s.yaw_rate for s in states if s.yaw_rate is not None]


def backward_error(found: str) -> CalibrationFailed:
    """Make the error for a car that drives against its throttle."""
    return CalibrationFailed(
        "a pulse above neutral drives the car backward", found=found,
        expected="acceleration forward",
        likely="the motor's leads are swapped, or the IMU is turned by 180 degrees (push the "
               "car forward by hand: accel_x must be positive)",
        remedy="swap the two leads of the motor, or mount_yaw = 3.1416 under [imu]")


def no_imu_error(found: str) -> CalibrationFailed:
    """Make the error for an IMU that sends nothing."""
    return CalibrationFailed("no data of the IMU", found=found, expected="100 samples per second",
                             likely="IMU unplugged, or reset by a voltage drop",
                             remedy="dart-hal doctor")


def encoder_doubt(state: State) -> NoMotion:
    """Make the error for a State whose speed is doubtful."""
    return NoMotion(
        "the encoder does not count the motion of the car",
        found=f"{', '.join(sorted(state.health.doubts))} at {state.speed:.2f} m/s",
        expected="edges that agree with throttle and accelerometer",
        likely="its cable is loose, its sensor too far from the ring, the ESC is off, or "
               "something holds the car",
        remedy="turn a wheel by hand and watch dart-hal doctor")


def _no_ticks(states: list[State], bias: float) -> CalibrationFailed:
    rates = yaw_rates(states[-100:])
    turning = bool(rates) and abs(float(np.mean(rates)) - bias) > MIN_TURN_RATE
    if turning:
        return CalibrationFailed(
            "the car turns but the encoder does not count",
            found=f"0 edges, yaw rate {np.mean(rates) - bias:+.2f} rad/s",
            expected="edges of the ring", likely="encoder unplugged, sensor too far from the ring",
            remedy="turn a wheel by hand and watch dart-hal doctor")
    return NoMotion(
        "the car does not move", found=f"0 edges in {states[-1].t - states[0].t:.0f} s of throttle",
        expected="motion at a throttle of about 0.25",
        likely="the ESC is off or has not armed (it needs 2 s of neutral after power-on), the "
               "battery is empty, or the encoder is dead and the wheels are off the ground",
        remedy="switch the ESC on, put the car on the floor, run dart-hal doctor")


def check_turning(recent: list[State], bias: float, left: bool) -> None:
    """Raise CalibrationFailed unless the yaw rate has the expected sign and size."""
    rates = yaw_rates(recent)
    if any(Doubt.IMU_DISAGREES.value in s.health.doubts for s in recent):
        raise _wrong_direction(left, "the other way", Doubt.IMU_DISAGREES.value)
    if not rates:
        raise CalibrationFailed("no yaw rate while driving", found="IMU not valid",
                                expected="100 Hz of gyro data",
                                likely="IMU unplugged or reset by a voltage drop",
                                remedy="dart-hal doctor")
    rate = float(np.mean(rates)) - bias
    if abs(rate) < MIN_TURN_RATE:
        raise CalibrationFailed(
            "the wheels turn but the car does not turn", found=f"yaw rate {rate:+.3f} rad/s",
            expected="about 0.7 rad/s at full lock",
            likely="the wheels are off the ground, the servo does not move, or the gyro is stuck",
            remedy="put the car on the floor; check the servo's plug (channel 0)")
    if (rate > 0.0) != left:
        raise _wrong_direction(left, f"to the {'left' if rate > 0 else 'right'}",
                         f"yaw rate {rate:+.2f} rad/s")


def _wrong_direction(left: bool, answer: str, found: str) -> CalibrationFailed:
    return CalibrationFailed(
        f"a command to the {'left' if left else 'right'} gives a yaw rate {answer}", found=found,
        expected="left commands give positive yaw rates",
        likely="the servo's direction is reversed, the IMU is mounted upside down (push the car to "
               "the left by hand: the yaw rate must be positive), or the car drove backward",
        remedy="if the wheels steer to the wrong side: [steering] direction = -1 in car.toml; if "
               "they steer correctly: mount_roll = 3.1416 under [imu]; if it drove backward: swap "
               "the two leads of the motor")
