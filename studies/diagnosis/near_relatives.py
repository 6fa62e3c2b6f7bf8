"""Near relatives: physics of the catalogue in a form that the catalogue does not have."""

from __future__ import annotations

import math

import numpy as np

from studies.diagnosis.stranger import (
    FRONT,
    MOMENT,
    REAR,
    SIDE_FRONT,
    SIDE_REAR,
    Car,
    G,
    H,
    Now,
    Truth,
    X,
)
from studies.diagnosis.stranger_causes import Cause


def ringing_servo(car: Car, k: float) -> None:
    """A position loop with overshoot, damping 0.5, that settles in k [s]."""
    w, state = 1.0 / k, [0.0, 0.0]

    def act(u: float, now: Now) -> float:
        state[1] += H * (w * w * (u - state[0]) - w * state[1])
        state[0] += H * state[1]
        return state[0]

    car.steer.append(act)


def cubic_drag(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * now.v**3

    car.force.append(act)


def linear_drag(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * now.v

    car.force.append(act)


def hard_rear(car: Car, k: float) -> None:
    """The rear axle slides at 1/k [N] and holds as ever below."""
    def act(f: list[float], now: Now) -> None:
        f[SIDE_REAR] = min(max(f[SIDE_REAR], -1.0 / k), 1.0 / k)

    car.force.append(act)


def slow_load_transfer(car: Car, k: float) -> None:
    """Load moves with the nose, which takes 0.15 s."""
    nose = [0.0]

    def watch(now: Now) -> None:
        nose[0] += (now.ax - nose[0]) * H / 0.15

    def act(f: list[float], now: Now) -> None:
        f[SIDE_FRONT] *= 1.0 - k * nose[0] / G
        f[SIDE_REAR] *= 1.0 + k * nose[0] / G

    car.step.append(watch)
    car.force.append(act)


def drive_load_transfer(car: Car, k: float) -> None:
    """Load moves with the drive force, whatever the car's acceleration."""
    def act(f: list[float], now: Now) -> None:
        moved = k * (f[FRONT] + f[REAR]) / (car.m * G)
        f[SIDE_FRONT] *= 1.0 - moved
        f[SIDE_REAR] *= 1.0 + moved

    car.force.append(act)


def square_damping(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[MOMENT] -= k * now.turn * abs(now.turn)

    car.force.append(act)


def rubber_linkage(car: Car, k: float) -> None:
    """A spring that gets stiffer: deflection with the root of the force."""
    twist = [0.0]

    def act(u: float, now: Now) -> float:
        force = now.grip_front
        wanted = k * math.copysign(math.sqrt(abs(force) + 0.04) - 0.2, force)
        twist[0] += (wanted - twist[0]) * H / 0.01
        return u - twist[0]

    car.angle.append(act)


def throttle_slew(car: Car, k: float) -> None:
    """The ESC opens its throttle by no more than 1/k per second."""
    held = [0.0]

    def act(u: float, now: Now) -> float:
        held[0] += min(max(u - held[0], -H / k), H / k)
        return held[0]

    car.gas.append(act)


def sagging_battery(car: Car, k: float) -> None:
    """Inner resistance: the share k is lost per 3 N of pull."""
    car.motor.append(lambda f, now: f / (1.0 + k * abs(f) / 3.0))


def falling_cell(car: Car, k: float) -> None:
    """A cell gives up: the motor loses k from second 50 on, within seconds."""
    car.motor.append(lambda f, now: f * (1.0 - k / (1.0 + math.exp(-(now.t - 50.0) / 3.0))))


def one_sided_gyro(car: Car, k: float) -> None:
    """Scale that is wrong to the left only."""
    car.gyro.append(lambda w, truth: np.where(w > 0.0, w * (1.0 + k), w))


def drifting_gyro(car: Car, k: float) -> None:
    """A zero that wanders by k [rad/s] per 100 s."""
    car.gyro.append(lambda w, truth: w + k * (0.5 + truth.t / 100.0))


def filtered_encoder(car: Car, k: float) -> None:
    """A low pass on the board, of k [s]."""
    def act(v: np.ndarray, truth: Truth) -> np.ndarray:
        return _low_pass(v, k)

    car.wheel.append(act)


def filtered_gyro(car: Car, k: float) -> None:
    car.gyro.append(lambda w, truth: _low_pass(w, k))


def square_cornering(car: Car, k: float) -> None:
    """Scrub of the steered wheels with the square of their angle [N/rad2]."""
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * now.angle**2 * math.tanh(now.v / 0.1)

    car.force.append(act)


def rubber_grip(car: Car, k: float) -> None:
    """Less friction at the same stiffness: only the peak of the front tyre falls."""
    car.D *= 1.0 - k
    car.B /= 1.0 - k


def wheel_spin(car: Car, k: float) -> None:
    """Slip of the wheels that grows with the cube of the pull."""
    car.wheel.append(lambda v, truth: v * (1.0 + k * truth.pull**3))


def _low_pass(v: np.ndarray, seconds: float) -> np.ndarray:
    from scipy.signal import lfilter
    keep = math.exp(-H / seconds)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], v, zi=[keep * v[0]])[0])


NEAR: dict[str, tuple[Cause, float]] = {
    "ringing_servo": (ringing_servo, 0.05), "cubic_drag": (cubic_drag, 0.08),
    "linear_drag": (linear_drag, 0.15), "hard_rear": (hard_rear, 0.43),
    "slow_load_transfer": (slow_load_transfer, 1.2),
    "drive_load_transfer": (drive_load_transfer, 0.4),
    "square_damping": (square_damping, 0.006), "rubber_linkage": (rubber_linkage, 0.02),
    "throttle_slew": (throttle_slew, 1.0), "sagging_battery": (sagging_battery, 0.12),
    "falling_cell": (falling_cell, 0.12), "one_sided_gyro": (one_sided_gyro, 0.05),
    "drifting_gyro": (drifting_gyro, 0.02), "filtered_encoder": (filtered_encoder, 0.06),
    "filtered_gyro": (filtered_gyro, 0.04), "square_cornering": (square_cornering, 4.0),
    "rubber_grip": (rubber_grip, 0.15), "wheel_spin": (wheel_spin, 0.03)}

FAMILY: dict[str, frozenset[str]] = {name: frozenset(family.split()) for name, family in {
    "ringing_servo": "steering_lag steering_delay steering_rate_limit",
    "cubic_drag": "quadratic_drag rolling_resistance motor_gain",
    "linear_drag": "quadratic_drag rolling_resistance motor_gain",
    "hard_rear": "rear_saturation roll_compliance combined_slip grip",
    "slow_load_transfer": "load_transfer combined_slip",
    "drive_load_transfer": "load_transfer",
    "square_damping": "yaw_damping differential_drag",
    "rubber_linkage": "steering_compliance steering_gain front_grip steering_backlash",
    "throttle_slew": "throttle_lag throttle_delay",
    "sagging_battery": "motor_gain motor_saturation battery_fade quadratic_drag motor_deadband",
    "falling_cell": "battery_fade motor_gain",
    "one_sided_gyro": "gyro_scale gyro_bias",
    "drifting_gyro": "gyro_bias",
    "filtered_encoder": "encoder_latency clock_offset",
    "filtered_gyro": "gyro_latency clock_offset",
    "square_cornering": "cornering_drag differential_drag",
    "rubber_grip": "grip front_grip roll_compliance steering_compliance",
    "wheel_spin": "encoder_slip encoder_scale"}.items()}
