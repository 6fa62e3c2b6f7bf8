"""Friction (folder 19), motor (29) and steering map (30) with the paper's preprocessing."""

from __future__ import annotations

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.filters import delay_values, slope, smooth

from .folders import JoinedRows
from .problem import CurveProblem

# a, b, c of the friction that the paper subtracted from its motor labels: not its published one.
LABEL_FRICTION = (1.6837230920791626, 13.49715518951416, 0.3352389633655548)
# [N] The paper takes a coasting row below it for an artefact.
HARDEST_BRAKING = -4.0
# [s] Time since the throttle closed, in the variant.
VARIANT_DELAY = 0.15
# [m/s] The paper takes rows above it, where tyres already slip a little.
MIN_FAST_SPEED = 0.8


def motion(rows: JoinedRows) -> tuple[FloatArray, FloatArray]:
    """Compute speed [m/s] smoothed over five rows, and force m dv/dt [N] by a spline, (n,)."""
    v = smooth(rows.speed, 5, 2)
    return v, PAPER.body.mass * slope(rows.t, v)


def is_coasting(rows: JoinedRows, force: FloatArray, variant: bool = False) -> BoolArray:
    """Return whether the friction fit uses each row (n,).

    The paper's rule: throttle 0, force above -4 N, which includes rest and braking by the ESC.
    variant: throttle 0 since 0.15 s, force negative.
    """
    if variant:
        return np.asarray((delay_values(rows.t, rows.throttle, VARIANT_DELAY) == 0.0)
                          & (force < 0.0))
    return np.asarray((rows.throttle == 0.0) & (force > HARDEST_BRAKING))


def friction_problem(rows: JoinedRows, variant: bool = False) -> CurveProblem:
    """Make the problem of the friction's a, b, c, from coasting."""
    v, force = motion(rows)
    use = is_coasting(rows, force, variant)
    p = PAPER.friction
    return CurveProblem(
        "friction", curves.friction, (v[use],), force[use], ("a", "b", "c"),
        ("N", "s/m", "N s/m"), (0.1, 1.0, 0.0), (3.0, 100.0, 2.0), "N",
        {1: (2.0, 4.0, 8.0, 12.0, 18.0, 30.0, 60.0)}, (p.a, p.b, p.c),
        needs="coasting: throttle 0")


def motor_problem(rows: JoinedRows) -> CurveProblem:
    """Make the problem of the motor's d, e, g: force minus the friction of the paper's labels."""
    v, force = motion(rows)
    label = force - curves.friction(np.array(LABEL_FRICTION), v)[0]
    p = PAPER.duty_motor
    return CurveProblem(
        "motor", curves.motor, (rows.throttle, v), label, ("d", "e", "g"), ("N", "N s/m", "-"),
        (5.0, 0.1, -0.3), (40.0, 10.0, 0.3), "N",
        {2: (-0.25, -0.2, -0.15, -0.1, -0.05, 0.0)}, (p.d, p.e, p.g),
        ("the paper's d, e, g are where 500 steps of ADAM stopped, not the optimum",
         "d, e and g are strongly correlated: use them together, with their covariance"))


def is_fast(rows: JoinedRows) -> BoolArray:
    """Return whether each row (n,) is above 0.8 m/s."""
    return np.asarray(rows.speed > MIN_FAST_SPEED)


def steering_problem(rows: JoinedRows) -> CurveProblem:
    """Make the problem of the map's five parameters, from atan(l omega / v)."""
    use = is_fast(rows)
    angle = np.arctan2(PAPER.body.wheelbase * rows.yaw_rate[use], rows.speed[use])
    p = PAPER.steering
    gains = (0.8, 1.5, 2.5)
    return CurveProblem(
        "steering", curves.steering, (rows.steering[use],), angle,
        ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"), ("-", "rad", "-", "rad", "-"),
        (0.1, 0.2, -0.1, 0.2, 0.1), (5.0, 0.6, 0.1, 0.6, 5.0), "rad",
        {0: gains, 2: (-0.05, 0.0, 0.05), 4: gains},
        (p.k_left, p.a_left_rad, p.s0, p.a_right_rad, p.k_right),
        needs="rows above 0.8 m/s")
