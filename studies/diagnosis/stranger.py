"""A car written from its equations alone, to drive with something hidden in it.

Nothing of the package is used: what the diagnosis takes for true must also hold
for a simulator that somebody else wrote. Midpoint rule, 2 ms, plain floats.
A cause is a function that hangs hooks on a ``Car`` (stranger_causes.py,
out_of_catalogue.py); a driver says what is commanded (stranger_drivers.py); what ends
up in a file is decided in stranger_files.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

H = 0.002
G = 9.81
STANDS = 0.01  # m/s
PER_DEGREE = 180.0 / math.pi
FRONT, REAR, SIDE_FRONT, SIDE_REAR, X, Y, MOMENT = range(7)
"""Where a force hook finds what it may change: drive and side force of both axles [N] in the
frame of their wheels, further forces on the body [N], further moment [N m]."""


class Now:
    """What hooks and drivers may look at; one object that moves along.

    x, y, yaw, v, side, turn: motion of the centre of mass; ax, ay: what the
    body feels [m/s2]; gas, steer: commands after delays; angle [rad]; motor,
    grip_front: force of the motor and side force of the front axle [N]; way [m].
    """

    def __init__(self) -> None:
        self.t = self.x = self.y = self.yaw = self.v = self.side = self.turn = 0.0
        self.ax = self.ay = self.gas = self.steer = self.angle = 0.0
        self.motor = self.grip_front = self.way = 0.0


Scalar = Callable[[float, Now], float]


@dataclass
class Car:
    """The car of the paper. Hooks act in the order in which they were hung."""

    m: float = 1.67
    inertia: float = 0.006513
    lf: float = 0.0805
    lr: float = 0.0945
    fa: float = 1.7194761037826538
    fb: float = 13.312559127807617
    fc: float = 0.289848655462265
    md: float = 28.887779235839844
    me: float = 5.986172199249268
    mg: float = -0.15045104920864105
    k_left: float = 1.6379064321517944
    a_left: float = 0.3301370143890381
    s0: float = 0.019644200801849365
    a_right: float = 0.37879398465156555
    k_right: float = 1.6578725576400757
    D: float = 2.9751534461975098
    C: float = 0.6866822242736816
    B: float = 0.29280123114585876
    E: float = -3.0720443725585938
    Cr: float = 0.38921865820884705
    steer_delay: float = 0.15
    gas_delay: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)  # m/s2 along x, y of the room
    steer: list[Scalar] = field(default_factory=list)
    gas: list[Scalar] = field(default_factory=list)
    angle: list[Scalar] = field(default_factory=list)
    motor: list[Scalar] = field(default_factory=list)
    force: list[Callable[[list[float], Now], None]] = field(default_factory=list)
    step: list[Callable[[Now], None]] = field(default_factory=list)
    wheel: list[Any] = field(default_factory=list)
    gyro: list[Any] = field(default_factory=list)
    imu: list[Any] = field(default_factory=list)
    pose: list[Any] = field(default_factory=list)
    counted: list[Any] = field(default_factory=list)
    age: dict[str, float] = field(default_factory=dict)
    imu_at: float = 0.0945  # m ahead of the rear axle
    imu_left: float = 0.0  # m to the left of its middle
    marks: int = 10
    lost_marks: int = 0

    def map(self, s: float) -> float:
        """Steering angle [rad] of a command."""
        u = s + self.s0
        w = 0.5 * (math.tanh(30.0 * u) + 1.0)
        return (w * self.a_left * math.tanh(self.k_left * u)
                + (1.0 - w) * self.a_right * math.tanh(self.k_right * u))


@dataclass
class Truth:
    """What happened, every H: t (n,) and one array per quantity; u, s: commands as given."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    v: np.ndarray
    side: np.ndarray
    turn: np.ndarray
    ax: np.ndarray
    ay: np.ndarray
    pull: np.ndarray
    u: np.ndarray
    s: np.ndarray

    def at(self, name: str, when: np.ndarray) -> np.ndarray:
        """A quantity between the steps, (len(when),)."""
        return np.interp(when, self.t, getattr(self, name))


def gusts(n: int, size: float, where: str, rng: np.random.Generator) -> np.ndarray:
    """Ornstein-Uhlenbeck disturbance (n, 3): forward, to the side [N], moment [N m]; 0.15 s.

    where: "centre" without a moment, "body" with an arm of 5 cm, "axles" of each axle.
    """
    from scipy.signal import lfilter
    keep = math.exp(-H / 0.15)
    white = rng.normal(size=(n + 500, 3)) * math.sqrt(1.0 - keep**2) * size
    out = lfilter([1.0], [1.0, -keep], white, axis=0)[500:]
    if where == "centre":
        out[:, 2] = 0.0
    elif where == "body":
        out[:, 2] *= 0.05
    else:
        front, rear = out[:, 1].copy(), out[:, 2].copy()
        out[:, 1], out[:, 2] = front + rear, 0.0805 * front - 0.0945 * rear
    return out


def drive(car: Car, driver: Callable[[float, Now], tuple[float, float]],
          ticks: Sequence[float], seconds: float, push: np.ndarray) -> Truth:
    """From standstill; the driver is asked at the ticks [s] only; push: from ``gusts``."""
    n = round(seconds / H)
    now, rows, pushes = Now(), [], push.tolist()
    us, ss = [0.0] * n, [0.0] * n
    late_u, late_s = round(car.gas_delay / H), round(car.steer_delay / H)
    clock = iter([*ticks, math.inf])
    due, u, s = next(clock), 0.0, 0.0
    for i in range(n):
        now.t = t = i * H
        if t + 1e-9 >= due:
            u, s = driver(t, now)
            while t + 1e-9 >= due:
                due = next(clock)
        us[i], ss[i] = u, s
        gas, steer = us[max(i - late_u, 0)], ss[max(i - late_s, 0)]
        for scalar in car.gas:
            gas = scalar(gas, now)
        for scalar in car.steer:
            steer = scalar(steer, now)
        now.gas, now.steer = gas, steer
        angle = car.map(steer)
        for scalar in car.angle:
            angle = scalar(angle, now)
        now.angle = angle
        for each in car.step:
            each(now)
        x, y, yaw, v, side, turn = now.x, now.y, now.yaw, now.v, now.side, now.turn
        hold = v * v / (v * v + 0.0025)  # friction keeps a standing car where it is
        px, py, pm = (hold * p for p in pushes[i])
        fx, fy, dw, pull = _forces(car, now, px, py, pm)
        still = v < STANDS  # tyres of a standing car hold it, steered or not
        gx, gy = car.tilt  # a tyre that holds the car on a slope pushes against gravity
        hold_side = gx * math.sin(yaw) - gy * math.cos(yaw)
        now.ax, now.ay = (fx / car.m, hold_side if still else fy / car.m)
        rows.append((t, x, y, yaw, v, side, turn, now.ax, now.ay, pull, u, s))
        half = 0.5 * H
        dv, ds = _slide(car, now, fx, fy)
        now.v, now.side, now.turn, now.yaw = v + half * dv, side + half * ds, turn + half * dw, (
            yaw + half * turn)
        fx, fy, dw, _ = _forces(car, now, px, py, pm)
        dv, ds = _slide(car, now, fx, fy)
        c, sn = math.cos(now.yaw), math.sin(now.yaw)
        now.x = x + H * (now.v * c - now.side * sn)
        now.y = y + H * (now.v * sn + now.side * c)
        now.way += H * now.v
        now.yaw = yaw + H * now.turn
        now.v, now.side, now.turn = v + H * dv, side + H * ds, turn + H * dw
        if still:
            now.side = now.turn = 0.0
    return Truth(*np.array(rows).T)


def _forces(car: Car, now: Now, px: float, py: float, pm: float
            ) -> tuple[float, float, float, float]:
    """Force on the body forward and to the side [N], yaw acceleration, drive per mass."""
    v, side, turn, d = now.v, now.side, now.turn, now.angle
    tilde = now.gas + car.mg
    motor = (car.md - car.me * v) * tilde * (math.tanh(100.0 * tilde) + 1.0) * 0.5
    for scalar in car.motor:
        motor = scalar(motor, now)
    wheels = motor - car.fa * math.tanh(car.fb * v) - car.fc * v
    safe = v + 0.1 * math.exp(-100.0 * v * v)
    a = (d - math.atan2(side + car.lf * turn, safe)) * PER_DEGREE * car.B
    front = car.D * math.sin(car.C * math.atan(a - car.E * (a - math.atan(a))))
    rear = -car.Cr * math.atan((side - car.lr * turn) / safe) * PER_DEGREE
    f = [0.5 * wheels, 0.5 * wheels, front, rear, px, py, pm]
    now.motor = motor
    for hook in car.force:
        hook(f, now)
    now.grip_front = f[SIDE_FRONT]
    c, s = math.cos(d), math.sin(d)
    across = f[SIDE_FRONT] * c + f[FRONT] * s
    return (f[REAR] + f[FRONT] * c - f[SIDE_FRONT] * s + f[X], across + f[SIDE_REAR] + f[Y],
            (car.lf * across - car.lr * f[SIDE_REAR] + f[MOMENT]) / car.inertia, wheels / car.m)


def _slide(car: Car, now: Now, fx: float, fy: float) -> tuple[float, float]:
    """Rates of forward and side velocity, with the part of gravity along a sloping floor."""
    gx, gy = car.tilt
    c, s = math.cos(now.yaw), math.sin(now.yaw)
    return (fx / car.m + now.turn * now.side + gx * c + gy * s,
            fy / car.m - now.turn * now.v - gx * s + gy * c)
