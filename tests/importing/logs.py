"""Logs of a simulated car in the forms in which laboratories keep them."""

from __future__ import annotations

import numpy as np

WHEELBASE = 0.32
MAX_ANGLE = 0.4


def make_log(seconds=60.0, seed=1, rate=100.0, limit=np.inf):
    """Return columns of a kinematic car: commands, poses of the rear axle, and ideal sensors.

    limit [m/s]: of the speed that the throttle sets.
    """
    rng = np.random.default_rng(seed)
    dt = 1.0 / rate
    n = round(seconds * rate)
    levels = np.repeat(rng.uniform(-0.9, 0.9, n // 80 + 1), 80)[:n]
    throttle = np.repeat(rng.uniform(0.15, 0.35, n // 200 + 1), 200)[:n]
    steering = np.zeros(n)
    speed = np.zeros(n)
    x, y, yaw = np.zeros((3, n))
    for k in range(1, n):
        steering[k] = steering[k - 1] + dt / 0.08 * (levels[k - 1] - steering[k - 1])
        speed[k] = speed[k - 1] + dt / 0.4 * (min(6.0 * throttle[k - 1], limit) - speed[k - 1])
        rate_k = speed[k] * np.tan(MAX_ANGLE * steering[k]) / WHEELBASE
        yaw[k] = yaw[k - 1] + dt * rate_k
        x[k] = x[k - 1] + dt * speed[k] * np.cos(yaw[k])
        y[k] = y[k - 1] + dt * speed[k] * np.sin(yaw[k])
    yaw_rate = speed * np.tan(MAX_ANGLE * steering) / WHEELBASE
    noise = rng.standard_normal((6, n))
    return {
        "t": 100.0 + dt * np.arange(n), "x": x + 3e-4 * noise[0], "y": y + 3e-4 * noise[1],
        "yaw": (yaw + 1e-3 * noise[2] + np.pi) % (2.0 * np.pi) - np.pi, "steering": levels,
        "throttle": throttle, "speed": speed + 0.01 * noise[3],
        "yaw_rate": yaw_rate + 0.01 * noise[4], "accel_x": np.gradient(speed, dt) + 0.1 * noise[5],
        "accel_y": speed * yaw_rate + 0.1 * noise[5]}


def write_csv(path, columns, delimiter=",", header=True, comment=""):
    """Write columns as a CSV file; return its path."""
    lines = [comment] if comment else []
    lines += [delimiter.join(columns)] if header else []
    lines += [delimiter.join(f"{v:.6f}" for v in row)
              for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


MAP = """
schema = "dart-hal/import/1"
name = "test"
time = "t"
[poses]
x = "x"
y = "y"
yaw = "yaw"
[steering]
value = "steering"
[throttle]
value = "throttle"
[encoder]
speed = "speed"
[gyro]
yaw_rate = "yaw_rate"
[accelerometer]
x = "accel_x"
y = "accel_y"
"""
