"""The single-track car of f1tenth_gym, rewritten with its operations: a peer of the simulation.

Equations: M. Althoff, G. Wuersching, "CommonRoad: Vehicle Models", section "Single-Track Model";
below 0.5 m/s the kinematic model. State: x, y [m], steering angle [rad], speed [m/s], yaw [rad],
yaw rate [rad/s], slip angle [rad]. Commands: steering rate [rad/s] and acceleration [m/s2]. As in
the original a step of 10 ms is one step of Runge-Kutta of fourth order, with limits of steering and
acceleration. It has linear tyres, no motor, no friction, no delay and no lag. f1tenth_gym itself is
not on the package index.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

Array = Any
Rates = tuple[Array, ...]

# Parameters of the 1:10 car of f1tenth_gym: friction coefficient, cornering stiffnesses [1/rad],
# distances of the axles and height of the centre of mass [m], mass [kg], yaw inertia [kg m2].
MU = 1.0489
C_F = 4.718
C_R = 5.4562
L_F = 0.15875
L_R = 0.17145
HEIGHT = 0.074
MASS = 3.74
INERTIA = 0.04712
# Limits: steering angle [rad], its rate [rad/s], acceleration [m/s2], the speed [m/s] from which it
# falls, speeds.
MAX_STEERING = 0.4189
MAX_STEERING_RATE = 3.2
MAX_ACCELERATION = 9.51
SWITCH_SPEED = 7.319
MIN_SPEED = -5.0
MAX_SPEED = 20.0
# Speed [m/s] below which the car is kinematic.
KINEMATIC_SPEED = 0.5
GRAVITY = 9.81
STEP = 0.01  # s


def make_step(xp: ModuleType, select: Callable[[Array, Array, Array], Array]
              ) -> Callable[[Rates, Array, Array], Rates]:
    """Return a function that drives a car on by ``STEP``: (state, steering rate, acceleration).

    xp: namespace of sin, cos and tan; select(condition, yes, no): as ``numpy.where``.
    """
    base = L_F + L_R

    def clip(value: Array, low: float, high: float) -> Array:
        value = select(value < low, low, value)
        return select(value > high, high, value)

    def rates(s: Rates, steering_rate: Array, acceleration: Array) -> Rates:
        _, _, delta, v, yaw, yaw_rate, slip = s
        # Limits of the steering and of the motor.
        u = clip(steering_rate, -MAX_STEERING_RATE, MAX_STEERING_RATE)
        u = select((delta <= -MAX_STEERING) & (u < 0.0), 0.0, u)
        u = select((delta >= MAX_STEERING) & (u > 0.0), 0.0, u)
        most = select(v > SWITCH_SPEED, MAX_ACCELERATION * SWITCH_SPEED / select(
            v > SWITCH_SPEED, v, 1.0), MAX_ACCELERATION)
        a = clip(acceleration, -MAX_ACCELERATION, MAX_ACCELERATION)
        a = select(a > most, most, a)
        a = select((v <= MIN_SPEED) & (a < 0.0), 0.0, a)
        a = select((v >= MAX_SPEED) & (a > 0.0), 0.0, a)
        # Kinematic model.
        tangent = xp.tan(delta)
        slow = (v * xp.cos(yaw), v * xp.sin(yaw), u, a, v / base * tangent,
                a / base * tangent + v / base * u * (1.0 + tangent * tangent), 0.0 * v)
        # Single-track model.
        w = select(v * v > KINEMATIC_SPEED * KINEMATIC_SPEED, v, KINEMATIC_SPEED)
        front = C_F * (GRAVITY * L_R - a * HEIGHT)
        rear = C_R * (GRAVITY * L_F + a * HEIGHT)
        turn = MU * MASS / (INERTIA * base)
        side = MU / (w * base)
        fast = (v * xp.cos(yaw + slip), v * xp.sin(yaw + slip), u, a, yaw_rate,
                turn * (-(L_F * L_F * front + L_R * L_R * rear) * yaw_rate / w
                        + (L_R * rear - L_F * front) * slip + L_F * front * delta),
                (side / w * (rear * L_R - front * L_F) - 1.0) * yaw_rate
                - side * (rear + front) * slip + side * front * delta)
        is_slow = v * v < KINEMATIC_SPEED * KINEMATIC_SPEED
        return tuple(select(is_slow, one, other) for one, other in zip(slow, fast, strict=True))

    def step(s: Rates, steering_rate: Array, acceleration: Array) -> Rates:
        def advance(k: Rates, share: float) -> Rates:
            return tuple(x + STEP * share * r for x, r in zip(s, k, strict=True))

        k1 = rates(s, steering_rate, acceleration)
        k2 = rates(advance(k1, 0.5), steering_rate, acceleration)
        k3 = rates(advance(k2, 0.5), steering_rate, acceleration)
        k4 = rates(advance(k3, 1.0), steering_rate, acceleration)
        return tuple(x + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                     for x, a, b, c, d in zip(s, k1, k2, k3, k4, strict=True))

    return step
