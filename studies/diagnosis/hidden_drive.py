"""Drives of a car with something hidden in it, written as the DART recorder writes them.

Nothing here is shared with the diagnosis but the equations: commands change
when they like, the recorder sees them once in 0.1 s, the encoder counts, the
gyro is rounded, the mocap looks at a marker off the rear axle.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.delay import delay_series
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.native.build import CannotCompile
from dart_hal.vehicle.native.kernel import make_native_step
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.step import make_motion_step

DT = 0.0025
EPOCH = 1_725_800_000.0  # 8 September 2024, so that the marker is where it was then
LX, THETA, LY = 0.115, 0.010, -0.010
COLUMNS = ("elapsed time sensors", "current", "voltage", "acc x (IMU)", "acc y (IMU)", "W (IMU)",
           "vel encoder", "safety_value", "throttle", "steering", "vicon time", "vicon x",
           "vicon y", "vicon yaw")


@dataclass(frozen=True)
class Plan:
    """How it is driven. force [N], memory [s]: an Ornstein-Uhlenbeck disturbance.

    fast: throttle when it drives, of least and most; None = as the style has it.
    lockstep: commands change with the messages; else whenever they like, and
    the recorder sees them up to 0.1 s later. series: (throttle, steering) at
    ``series_dt`` [s] in place of a style; they say how long it takes.
    """

    seconds: float = 60.0
    style: str = "rich"
    force: float = 0.12
    memory: float = 0.15
    lockstep: bool = True
    series: tuple | None = None
    series_dt: float = 0.01
    fast: tuple[float, float] | None = None


def commands(plan, rng):
    """(throttle, steering) (n,) on DT: steps of both, and waves of the steering."""
    if plan.series is not None:
        return tuple(np.repeat(s, round(plan.series_dt / DT)) for s in plan.series)
    n = round(plan.seconds / DT)
    t = np.arange(n) * DT
    throttle, steering = np.zeros(n), np.zeros(n)
    fast = {"rich": (0.21, 0.34), "gentle": (0.20, 0.26)}[plan.style]
    fast = plan.fast or fast
    at = 1.0
    while at < plan.seconds:
        hold = rng.uniform(0.8, 3.0)
        throttle[t >= at] = rng.uniform(*fast) if rng.random() > 0.12 else 0.0
        at += hold
    at = 1.0
    while at < plan.seconds:
        hold = rng.uniform(0.4, 2.5)
        here = (t >= at) & (t < at + hold)
        level = rng.uniform(-0.95, 0.95)
        if rng.random() < 0.4:
            wave = np.sin(2 * np.pi * rng.uniform(0.3, 1.2) * (t - at))
            steering[here] = level * wave[here]
        else:
            steering[here] = level
        at += hold
    return throttle, steering


def motion(p, throttle, steering, plan, rng):
    """States (n + 1, 6) of the centre of mass, accelerations (n, 3), drive force (n,)."""
    q = apply_parameter_effects(p)
    t = np.arange(len(throttle)) * DT
    d = q.delay
    tau = _lag(delay_series(throttle, d.throttle_s, DT), d.throttle_lag_s)
    command = _lag(delay_series(steering, d.steering_s, DT), d.steering_lag_s)
    command = transform_signal(p, "steering", command, Now(t), DT)
    angle = transform_signal(p, "angle", make_steering(q.steering, np)(command), Now(t), DT)
    tau = transform_signal(p, "throttle", tau, Now(t), DT)
    try:
        step = make_native_step(p, "motion", DT)
    except CannotCompile:
        step = make_motion_step(p, dt=DT)
    keep = np.exp(-DT / plan.memory)
    kicks = np.zeros((len(tau), 3))
    noise = rng.normal(size=(len(tau), 3)) * np.sqrt(1.0 - keep**2)
    for i in range(1, len(tau)):
        kicks[i] = keep * kicks[i - 1] + noise[i]
    kicks *= plan.force * np.array([1.0, 1.0, 0.05]) * DT
    kicks /= [q.body.mass, q.body.mass, q.body.yaw_inertia]
    states = np.zeros((len(tau) + 1, 6))
    state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(len(tau)):
        x, y, eta, vx, vy, om = step(*state, float(tau[i]), float(angle[i]))
        moving = 1.0 if abs(vx) > 0.05 else 0.0  # a standing car is held by its friction
        k = kicks[i] * moving
        state = (x, y, eta, vx + k[0], vy + k[1], om + k[2])
        states[i + 1] = state
    rate = np.diff(states[:, 3:], axis=0) / DT
    mid = 0.5 * (states[1:] + states[:-1])
    accel = np.stack([rate[:, 0] - mid[:, 5] * mid[:, 4], rate[:, 1] + mid[:, 5] * mid[:, 3],
                      rate[:, 2]], axis=1)
    drive = make_motor(q.motor, np)(tau, mid[:, 3]) + make_friction(q.friction, np)(mid[:, 3])
    return states, accel, drive


def _lag(series, lag):
    if lag <= 0.0:
        return series
    from scipy.signal import lfilter
    keep = np.exp(-DT / lag)
    return lfilter([1.0 - keep], [1.0, -keep], series, zi=[keep * series[0]])[0]


def write(path, p=PAPER, seed=0, plan=Plan()):
    """Drive and write one schema B file; returns its path."""
    rng = np.random.default_rng(seed)
    throttle, steering = commands(plan, rng)
    heard = np.arange(rng.uniform(0.02, 0.1), len(throttle) * DT - DT, 0.1)
    if plan.lockstep:
        at = np.searchsorted(heard, np.arange(len(throttle)) * DT, side="right") - 1
        at = np.maximum(at, 0)
        index = np.clip(np.ceil(heard / DT).astype(int), 0, len(throttle) - 1)
        throttle, steering = throttle[index][at], steering[index][at]
    states, accel, drive = motion(p, throttle, steering, plan, rng)
    s = states[1:]
    t = (np.arange(len(s)) + 1) * DT
    now = Now(t, *s[:, [3, 4, 5, 2]].T, *accel.T, drive, np.cumsum(s[:, 3]) * DT / 0.0412925)
    wheel = transform_signal(p, "wheel", s[:, 3].copy(), now, DT)
    gyro = transform_signal(p, "gyro", s[:, 5].copy(), now, DT)
    ax, ay = transform_signal(p, "accel", (accel[:, 0].copy(), accel[:, 1].copy()), now, DT)
    every = round(0.01 / DT)
    l_r = apply_parameter_effects(p).body.l_r
    rows = s[every - 1::every]
    yaw = rows[:, 2] - THETA
    c, sn = np.cos(rows[:, 2]), np.sin(rows[:, 2])
    forward = LX - l_r
    pose = (rows[:, 0] + forward * c - LY * sn, rows[:, 1] + forward * sn + LY * c, yaw)
    fine = Now(*(f[every - 1::every] for f in now[:now._fields.index("voltage")]))
    x, y, yaw = transform_signal(p, "pose", pose, fine, 0.01)
    x, y = (v + rng.normal(size=len(v)) * 1e-4 for v in (x, y))
    yaw = yaw + rng.normal(size=len(yaw)) * 5e-4
    stamps = fine.t
    index = np.clip(np.ceil(heard / DT).astype(int), 0, len(t) - 1)
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(wheel)) * DT])
    counts = np.floor(travelled / 0.0041292)
    window = round(0.1 / DT)
    speed = (counts[index] - counts[np.maximum(index - window, 0)]) * 0.0041292 / 0.1
    table = np.stack([
        heard + 100.0, np.zeros(len(heard)), np.zeros(len(heard)),
        np.round(ax[index] + rng.normal(size=len(index)) * 0.5, 2),
        np.round(ay[index] + rng.normal(size=len(index)) * 0.5, 2),
        np.round((gyro[index] + rng.normal(size=len(index)) * 0.003) / 0.00109083) * 0.00109083,
        speed, np.ones(len(heard)), throttle[index], steering[index]], axis=1)
    late = heard + rng.uniform(0.001, 0.006, len(heard))  # the recorder has it then
    which = np.searchsorted(late, stamps, side="right") - 1
    held = np.where(which[:, None] >= 0, table[np.maximum(which, 0)], 0.0)
    full = np.column_stack([held, EPOCH + stamps, x, y, (yaw + np.pi) % (2 * np.pi) - np.pi])
    path = Path(path)
    with path.open("w") as file:
        file.write(",".join(COLUMNS) + "\r\n")
        np.savetxt(file, full, fmt=["%.6f"] * 10 + ["%.6f", "%.7f", "%.7f", "%.7f"],
                   delimiter=",", newline="\r\n")
    return path
