"""Every effect of the catalogue, as somebody else would write it: near the catalogue, not in it.

``hide(car, name, size)`` changes a car in place. Sizes and signs are those that
the catalogue states, so that what is found can be held against what was hidden.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from studies.diagnosis.stranger import FRONT, MOMENT, REAR, SIDE_FRONT, SIDE_REAR, Car, G, H, Now, X
from studies.diagnosis.stranger_causes_sensors import SENSORS, imu_offset_y

Cause = Callable[[Car, float], None]


def _every(seconds: float, rule: Callable[[float, float], float]) -> Callable[[float, Now], float]:
    """A discrete filter y = rule(y, u) at its own rate, held in between."""
    state: list[Any] = [None, 0.0]

    def act(u: float, now: Now) -> float:
        if state[0] is None or now.t == 0.0:  # the same car drives more than once
            state[0], state[1] = u, 0.0
        if now.t + 1e-9 >= state[1]:
            state[0] = rule(state[0], u)
            state[1] += seconds
        return float(state[0])

    return act


def steering_delay(car: Car, k: float) -> None:
    car.steer_delay += 0.01 * round(k / 0.01)


def throttle_delay(car: Car, k: float) -> None:
    car.gas_delay += 0.01 * round(k / 0.01)


def steering_lag(car: Car, k: float) -> None:
    """Second order without overshoot: a position loop behind a short electrical one."""
    slow, fast, state = 0.85 * k, 0.15 * k, [0.0, 0.0]

    def act(u: float, now: Now) -> float:
        state[0] += (1.0 - math.exp(-H / fast)) * (u - state[0])
        state[1] += (1.0 - math.exp(-H / slow)) * (state[0] - state[1])
        return state[1]

    car.steer.append(act)


def throttle_lag(car: Car, k: float) -> None:
    car.gas.append(_every(0.01, lambda y, u: y + (u - y) * 0.01 / (k + 0.005)))


def steering_rate_limit(car: Car, k: float) -> None:
    most = 0.45 / k * H  # rad per step: a unit of command is about 0.45 rad of wheel
    angle = [0.0]

    def act(u: float, now: Now) -> float:
        angle[0] += min(max(u - angle[0], -most), most)
        return angle[0]

    car.angle.append(act)


def steering_backlash(car: Car, k: float) -> None:
    """Hysteresis of the rod, before the geometry of the linkage bends the curve."""
    half, held = 0.5 * k / 0.58, [0.0]

    def act(u: float, now: Now) -> float:
        if u - held[0] > half:
            held[0] = u - half
        elif u - held[0] < -half:
            held[0] = u + half
        return held[0]

    car.steer.append(act)


def steering_dead_zone(car: Car, k: float) -> None:
    """The wheels leave the middle softly, as rubber gives way."""
    half = 0.5 * k
    rubber = 0.2 * half
    before = half - math.hypot(half, rubber)

    def act(u: float, now: Now) -> float:
        beyond = abs(u) - half
        return math.copysign(0.5 * (beyond + math.hypot(beyond, rubber) + before), u)

    car.angle.append(act)


def steering_trim(car: Car, k: float) -> None:
    car.angle.append(lambda u, now: math.atan(math.tan(u) + k))


def steering_gain(car: Car, k: float) -> None:
    car.angle.append(lambda u, now: math.atan((1.0 + k) * math.tan(u)))


def steering_compliance(car: Car, k: float) -> None:
    """A spring with a little damping between servo and wheels."""
    twist = [0.0]

    def act(u: float, now: Now) -> float:
        twist[0] += (k * now.grip_front - twist[0]) * H / 0.01
        return u - twist[0]

    car.angle.append(act)


def motor_gain(car: Car, k: float) -> None:
    car.motor.append(lambda f, now: f * (1.0 + k))


def back_emf(car: Car, k: float) -> None:
    car.motor.append(lambda f, now: max(0.0, f - k * now.v) if f > 0.0 < now.v else f)


def battery_fade(car: Car, k: float) -> None:
    car.motor.append(lambda f, now: f * math.exp(k * now.t / 100.0))


def motor_deadband(car: Car, k: float) -> None:
    car.gas.append(lambda u, now: u - k if u > 0.05 else u)


def motor_saturation(car: Car, k: float) -> None:
    car.gas.append(lambda u, now: min(u, 1.0 / k))


def pwm_quantisation(car: Car, k: float) -> None:
    wide = k * 375.0  # us
    car.steer.append(lambda u, now: round(375.0 * u / wide) * wide / 375.0)
    car.gas.append(lambda u, now: round(450.0 * u / wide) * wide / 450.0)


def pwm_clock(car: Car, k: float) -> None:
    car.steer.append(lambda u, now: ((1560.0 + 375.0 * u) * (1.0 + k) - 1560.0) / 375.0)
    car.gas.append(lambda u, now: ((1500.0 + 450.0 * u) * (1.0 + k) - 1500.0) / 450.0)


def _sign(v: float) -> float:
    return v / math.sqrt(v * v + 0.0025)


def rolling_resistance(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * _sign(now.v)

    car.force.append(act)


def quadratic_drag(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[X] -= k * now.v * abs(now.v)

    car.force.append(act)


def cornering_drag(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[FRONT] -= k * abs(math.sin(now.angle)) * _sign(now.v)

    car.force.append(act)


def differential_drag(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[MOMENT] -= k * now.turn / math.hypot(now.v, 0.2)

    car.force.append(act)


def grip(car: Car, k: float) -> None:
    car.D *= 1.0 + k
    car.Cr *= 1.0 + k


def front_grip(car: Car, k: float) -> None:
    car.D *= 1.0 + k


def rear_saturation(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[SIDE_REAR] = math.tanh(k * f[SIDE_REAR]) / k

    car.force.append(act)


def combined_slip(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        for drive, side in ((FRONT, SIDE_FRONT), (REAR, SIDE_REAR)):
            f[side] /= math.sqrt(1.0 + k * (f[drive] / 3.0)**2)

    car.force.append(act)


def load_transfer(car: Car, k: float) -> None:
    """Centre of mass at a height; each axle's side force goes with its load."""
    height, wheelbase = k * 0.0875, car.lf + car.lr

    def act(f: list[float], now: Now) -> None:
        moved = car.m * now.ax * height / wheelbase
        f[SIDE_FRONT] *= 1.0 - moved / (car.m * G * car.lr / wheelbase)
        f[SIDE_REAR] *= 1.0 + moved / (car.m * G * car.lf / wheelbase)

    car.force.append(act)


def roll_compliance(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        loss = 1.0 + k * (now.ay / G)**2
        f[SIDE_FRONT] /= loss
        f[SIDE_REAR] /= loss

    car.force.append(act)


def yaw_damping(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[MOMENT] -= k * now.turn

    car.force.append(act)


def lateral_pull(car: Car, k: float) -> None:
    def act(f: list[float], now: Now) -> None:
        f[MOMENT] += k * _sign(now.v)

    car.force.append(act)


def road_slope_x(car: Car, k: float) -> None:
    car.tilt = (car.tilt[0] + k, car.tilt[1])


def road_slope_y(car: Car, k: float) -> None:
    car.tilt = (car.tilt[0], car.tilt[1] + k)


def mass(car: Car, k: float) -> None:
    car.m *= 1.0 + k


def yaw_inertia(car: Car, k: float) -> None:
    car.inertia *= 1.0 + k


def centre_of_mass(car: Car, k: float) -> None:
    """The weight moves; marker, IMU and axles stay where they are."""
    car.lf, car.lr = car.lf - k, car.lr + k


ACTUATORS: dict[str, Cause] = {f.__name__: f for f in (
    steering_delay, steering_lag, steering_rate_limit, steering_backlash, steering_trim,
    steering_gain, steering_compliance, throttle_delay, throttle_lag, motor_gain, battery_fade,
    motor_deadband, motor_saturation, pwm_quantisation, pwm_clock)}
FORCES: dict[str, Cause] = {f.__name__: f for f in (
    rolling_resistance, quadratic_drag, cornering_drag, differential_drag, grip, front_grip,
    rear_saturation, combined_slip, load_transfer, roll_compliance, yaw_damping, lateral_pull,
    road_slope_x, road_slope_y, mass, yaw_inertia, centre_of_mass)}
ALONE: dict[str, Cause] = {f.__name__: f for f in (
    imu_offset_y, steering_dead_zone, back_emf)}
"""Known later than the others: not in pairs, whose draws were counted without."""
CAUSES: dict[str, Cause] = ACTUATORS | FORCES | SENSORS | ALONE

SIZES: dict[str, tuple[float, float, float]] = {
    "steering_delay": (0.02, 0.04, 0.08), "steering_lag": (0.03, 0.06, 0.12),
    "steering_rate_limit": (0.125, 0.25, 0.5), "steering_backlash": (0.02, 0.05, 0.10),
    "steering_dead_zone": (0.02, 0.05, 0.10),
    "steering_trim": (0.005, 0.01, 0.02), "steering_gain": (0.02, 0.05, 0.10),
    "steering_compliance": (0.003, 0.008, 0.02), "throttle_delay": (0.03, 0.06, 0.12),
    "throttle_lag": (0.04, 0.08, 0.16), "motor_gain": (0.03, 0.08, 0.15),
    "battery_fade": (0.03, 0.08, 0.15), "motor_deadband": (0.005, 0.01, 0.02),
    "motor_saturation": (2.8, 3.3, 4.0), "pwm_quantisation": (0.013, 0.026, 0.052),
    "pwm_clock": (0.002, 0.005, 0.01), "rolling_resistance": (0.1, 0.25, 0.5),
    "quadratic_drag": (0.03, 0.08, 0.2), "cornering_drag": (0.3, 1.0, 2.0),
    "differential_drag": (0.01, 0.02, 0.04), "grip": (0.05, 0.1, 0.2),
    "front_grip": (0.05, 0.1, 0.2), "rear_saturation": (0.15, 0.25, 0.40),
    "combined_slip": (0.75, 1.5, 3.0), "load_transfer": (0.2, 0.4, 0.8),
    "roll_compliance": (0.2, 0.5, 1.0), "yaw_damping": (0.003, 0.01, 0.03),
    "lateral_pull": (0.003, 0.01, 0.03), "road_slope_x": (0.05, 0.1, 0.2),
    "road_slope_y": (0.05, 0.1, 0.2), "mass": (0.05, 0.1, 0.2), "yaw_inertia": (0.3, 0.6, 1.2),
    "centre_of_mass": (0.003, 0.006, 0.012), "encoder_scale": (0.005, 0.015, 0.04),
    "encoder_slip": (0.005, 0.015, 0.04), "encoder_latency": (0.01, 0.03, 0.06),
    "encoder_ring": (0.05, 0.1, 0.2), "gyro_bias": (0.005, 0.02, 0.05),
    "gyro_scale": (0.01, 0.03, 0.06), "gyro_latency": (0.02, 0.04, 0.08),
    "imu_pitch": (0.01, 0.02, 0.05), "imu_roll": (0.01, 0.02, 0.05),
    "imu_yaw": (0.02, 0.05, 0.1), "imu_lever_arm": (0.02, 0.05, 0.1),
    "imu_offset_y": (0.01, 0.02, 0.05), "mocap_latency": (0.01, 0.03, 0.06),
    "mocap_offset_x": (0.003, 0.008, 0.02), "mocap_offset_y": (0.003, 0.008, 0.02),
    "mocap_yaw": (0.005, 0.01, 0.03), "clock_offset": (0.01, 0.03, 0.06),
    "back_emf": (0.2, 0.5, 1.0),
}
EITHER_SIGN = frozenset((
    "steering_trim", "steering_gain", "motor_gain", "motor_deadband", "pwm_clock", "grip",
    "front_grip", "lateral_pull", "road_slope_x", "road_slope_y", "centre_of_mass",
    "encoder_scale", "gyro_bias", "gyro_scale", "imu_pitch", "imu_roll", "imu_yaw", "imu_lever_arm",
    "imu_offset_y", "mocap_offset_x", "mocap_offset_y", "mocap_yaw"))
NEGATIVE = frozenset(("battery_fade",))


def signed(name: str, which: int, rng: np.random.Generator) -> float:
    """Small (0), medium (1) or large (2), of either sign where there are two."""
    size = SIZES[name][which]
    if name in NEGATIVE:
        return -size
    return float(size * rng.choice([-1.0, 1.0])) if name in EITHER_SIGN else size


def hide(car: Car, name: str, size: float) -> Car:
    """Put a cause into a car; returns the car."""
    CAUSES[name](car, size)
    return car
