"""What may be wrong with the sensors of a stranger's car."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter1d

from studies.diagnosis.stranger import Car, G, H, Truth


def encoder_scale(car: Car, k: float) -> None:
    car.wheel.append(lambda v, truth: v * (1.0 + k))


def encoder_slip(car: Car, k: float) -> None:
    """Slip ratio in proportion to what the wheels pull."""
    car.wheel.append(lambda v, truth: v / (1.0 - k * truth.pull))


def encoder_latency(car: Car, k: float) -> None:
    car.age["encoder"] = car.age.get("encoder", 0.0) + k


def encoder_ring(car: Car, k: float) -> None:
    """Marks that fell off, one of 20 or one or two of 10: really missing, really counted."""
    car.marks = 20 if k < 0.07 else 10
    car.lost_marks = round(k * car.marks)


def gyro_bias(car: Car, k: float) -> None:
    car.gyro.append(lambda w, truth: w + k)


def gyro_scale(car: Car, k: float) -> None:
    car.gyro.append(lambda w, truth: w * (1.0 + k))


def gyro_latency(car: Car, k: float) -> None:
    """A mean over twice the time, causal."""
    size = round(2.0 * k / H)
    car.gyro.append(lambda w, truth: uniform_filter1d(w, size, origin=(size - 1) // 2))


def _turned(axis: int, k: float) -> Callable[[Car, float], None]:
    def act(car: Car, k: float) -> None:
        c, s = math.cos(k), math.sin(k)

        def felt(ax: np.ndarray, ay: np.ndarray, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
            if axis == 0:
                return c * ax - s * G, ay
            if axis == 1:
                return ax, c * ay + s * G
            return c * ax + s * ay, c * ay - s * ax

        car.imu.append(felt)
        if axis < 2:
            car.gyro.append(lambda w, truth: w * c)

    return act


def imu_pitch(car: Car, k: float) -> None:
    _turned(0, k)(car, k)


def imu_roll(car: Car, k: float) -> None:
    _turned(1, k)(car, k)


def imu_yaw(car: Car, k: float) -> None:
    _turned(2, k)(car, k)


def imu_lever_arm(car: Car, k: float) -> None:
    car.imu_at += k


def imu_offset_y(car: Car, k: float) -> None:
    car.imu_left += k


def mocap_latency(car: Car, k: float) -> None:
    car.age["pose"] = car.age.get("pose", 0.0) + k


def mocap_offset_x(car: Car, k: float) -> None:
    car.pose.append(lambda ahead, left, turned: (ahead + k, left, turned))


def mocap_offset_y(car: Car, k: float) -> None:
    car.pose.append(lambda ahead, left, turned: (ahead, left + k, turned))


def mocap_yaw(car: Car, k: float) -> None:
    car.pose.append(lambda ahead, left, turned: (ahead, left, turned + k))


def clock_offset(car: Car, k: float) -> None:
    """All that the board on the car sends is older than its stamp; commands are not."""
    for key in ("encoder", "gyro", "accel"):
        car.age[key] = car.age.get(key, 0.0) + k


SENSORS: dict[str, Callable[[Car, float], None]] = {f.__name__: f for f in (
    encoder_scale, encoder_slip, encoder_latency, encoder_ring, gyro_bias, gyro_scale,
    gyro_latency, imu_pitch, imu_roll, imu_yaw, imu_lever_arm, mocap_latency, mocap_offset_x,
    mocap_offset_y, mocap_yaw, clock_offset)}
