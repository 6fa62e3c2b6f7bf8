"""Friction (folder 19), motor (29) and steering map (30) with the paper's preprocessing."""

from __future__ import annotations

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.filters import later, slope, smooth

from .folders import JoinedRows
from .problem import CurveProblem

LABEL_FRICTION = (1.6837230920791626, 13.49715518951416, 0.3352389633655548)
"""a, b, c of the friction that the paper took off its motor labels: not its published one."""
HARDEST_BRAKING = -4.0  # N; below it the paper takes a coasting row for an artefact
VARIANT_DELAY = 0.15  # s
FAST = 0.8
"""m/s; the paper takes rows above it, where tyres already slip a little."""


def motion(rows: JoinedRows) -> tuple[FloatArray, FloatArray]:
    """Speed [m/s] smoothed over five rows, and force m dv/dt [N] by its spline, (n,) each."""
    v = smooth(rows.speed, 5, 2)
    return v, PAPER.body.mass * slope(rows.t, v)


def coasting(rows: JoinedRows, force: FloatArray, variant: bool = False) -> BoolArray:
    """Rows (n,) that the friction fit uses.

    The paper's: throttle 0, force above -4 N; files that begin at rest and
    braking by the ESC are in. variant: throttle 0 since 0.15 s, force negative.
    """
    if variant:
        return np.asarray((later(rows.t, rows.throttle, VARIANT_DELAY) == 0.0) & (force < 0.0))
    return np.asarray((rows.throttle == 0.0) & (force > HARDEST_BRAKING))


def friction_problem(rows: JoinedRows, variant: bool = False) -> CurveProblem:
    """a, b, c of the friction, from coasting."""
    v, force = motion(rows)
    use = coasting(rows, force, variant)
    p = PAPER.friction
    return CurveProblem(
        "friction", curves.friction, (v[use],), force[use], ("a", "b", "c"),
        ("N", "s/m", "N s/m"), (0.1, 1.0, 0.0), (3.0, 100.0, 2.0), "N",
        {1: (2.0, 4.0, 8.0, 12.0, 18.0, 30.0, 60.0)}, (p.a, p.b, p.c),
        needs="coasting: throttle 0")


def motor_problem(rows: JoinedRows) -> CurveProblem:
    """d, e, g of the motor: force less the friction that the paper's labels were made with."""
    v, force = motion(rows)
    label = force - curves.friction(np.array(LABEL_FRICTION), v)[0]
    p = PAPER.motor
    return CurveProblem(
        "motor", curves.motor, (rows.throttle, v), label, ("d", "e", "g"), ("N", "N s/m", "-"),
        (5.0, 0.1, -0.3), (40.0, 10.0, 0.3), "N",
        {2: (-0.25, -0.2, -0.15, -0.1, -0.05, 0.0)}, (p.d, p.e, p.g),
        ("the paper's d, e, g are where 500 steps of ADAM stopped, not the optimum",
         "d, e and g are strongly correlated: use them together, with their covariance"))


def fast(rows: JoinedRows) -> BoolArray:
    """Rows (n,) above 0.8 m/s."""
    return np.asarray(rows.speed > FAST)


def steering_problem(rows: JoinedRows) -> CurveProblem:
    """The five numbers of the map, from atan(l W / v)."""
    use = fast(rows)
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
