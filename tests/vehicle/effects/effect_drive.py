"""One drive with every sensor on board, for any vehicle."""

from __future__ import annotations

import math

import numpy as np

from dart_hal.vehicle import PAPER, UPSTREAM_2024, make_friction, make_motor_gains, make_steering
from dart_hal.vehicle.bicycle import make_dynamic
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.step import make_car_step

SAMPLE_TIME = 0.01
DRIVE_SECONDS = 10.0
PER_TURN = 2.0 * math.pi * 11.0 / 39.0 * 0.0233     # m of travel per turn of the encoder's gear


def commands():
    """(throttle, steering): steps of both, left and right, one throttle above 0.4."""
    t = np.arange(round(DRIVE_SECONDS / SAMPLE_TIME)) * SAMPLE_TIME
    levels = np.array([0.3, 0.42, 0.24, 0.36, 0.28, 0.33, 0.22, 0.3, 0.38, 0.25])
    throttle = levels[(t / 1.0).astype(int)]
    steering = 0.55 * np.sin(2.0 * math.pi * (0.25 + 0.06 * t) * t) * np.sign(np.sin(1.9 * t + 0.4))
    return t, throttle, steering


def late(series, seconds):
    by = round(seconds / SAMPLE_TIME)
    return np.concatenate([np.full(by, series[0]), series[:len(series) - by]])


def drive(p):
    """{channel: series} of the standard drive: what commands, motion and sensors become."""
    q = apply_parameter_effects(p)
    t, throttle, steering = commands()
    clock = Now(t=t)
    tau = transform_signal(q, "throttle", late(throttle, q.delay.throttle_s), clock, SAMPLE_TIME)
    s = transform_signal(q, "steering", late(steering, q.delay.steering_s), clock, SAMPLE_TIME)
    # the linkage is behind the servo: its change of the angle as a change of the command
    curve = make_steering(q.steering)
    angle = np.array([curve(v) for v in s.tolist()])
    moved = transform_signal(q, "angle", angle, clock, SAMPLE_TIME) - angle
    slope = 0.5 * (q.steering.a_left_rad * q.steering.k_left
                   + q.steering.a_right_rad * q.steering.k_right)
    step = make_car_step(q, math, SAMPLE_TIME)
    state = (0.0, 0.0, 0.0, 1.5, 0.0, 0.0, tau[0], s[0])
    states = []
    for command in zip(tau.tolist(), (s + moved / slope).tolist(), strict=True):
        state = step(*state, *command)
        states.append(state)
    return simulate_sensors(q, np.array(states).T, t)


def simulate_sensors(q, states, t):
    """Channels of the sensors for states (8, n)."""
    x, y, eta, vx, vy, om, tau, s = states
    delta = make_steering(q.steering, np)(s)
    k0, k1 = make_motor_gains(q.motor, np)(tau)
    rates = make_dynamic(q, np)(eta, vx, vy, om, k0, k1, 0.0, np.cos(delta), np.sin(delta))
    a_x = rates[3] - om * vy
    a_y = rates[4] + om * vx
    now = Now(t, vx, vy, om, eta, a_x, a_y, rates[5],
              k0 - k1 * vx + make_friction(q.friction, np)(vx),
              np.cumsum(vx) * SAMPLE_TIME / PER_TURN)
    true = {"wheel": vx, "gyro": om, "accel": (a_x, a_y), "pose": (x, y, eta)}
    out = {name: transform_signal(q, name, series, now, SAMPLE_TIME) for name,
           series in true.items()}
    return {"v_x": vx, "v_y": vy, "omega": om, "wheel": out["wheel"], "gyro": out["gyro"],
            "a_x": out["accel"][0], "a_y": out["accel"][1], "x": out["pose"][0],
            "y": out["pose"][1], "yaw": out["pose"][2], "throttle": tau, "angle": delta}


def medium(effect, size=1, sign=1.0):
    """Values of an effect at one of its sizes, on the side that its bounds allow."""
    return {q.name: q.null + (sign if q.low < q.null - q.sizes[size] else 1.0) * q.sizes[size]
            for q in effect.parameters if q.alone}


EFFECT_NAMES = tuple(catalogue())
EFFECT_CARS = {"paper": PAPER, "upstream": UPSTREAM_2024}


def noise(channel, n=60, lanes=(), seed=5):
    """(signal, now) of a channel as arrays (n, *lanes): smooth enough to be a car's."""
    draw = np.random.default_rng(seed)

    def rows(count):
        return np.cumsum(draw.normal(scale=0.08, size=(count, n, *lanes)), axis=1)

    t = np.arange(n) * SAMPLE_TIME
    now = Now(t, *rows(len(Now._fields) - 1))
    several = {"accel": 2, "pose": 3}.get(channel)
    return (tuple(rows(several)) if several else rows(1)[0]), now
