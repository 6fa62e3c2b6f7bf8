"""Steering map (folder 30) with the paper's preprocessing."""

from __future__ import annotations

import numpy as np

from dart_hal.types import BoolArray
from dart_hal.vehicle.sets import PAPER

from . import curves
from .folders import Rows
from .problem import Problem

FAST = 0.8
"""m/s; the paper takes rows above it, where tyres already slip a little."""


def fast(rows: Rows) -> BoolArray:
    """Rows (n,) above 0.8 m/s."""
    return np.asarray(rows.speed > FAST)


def steering_problem(rows: Rows) -> Problem:
    """The five numbers of the map, from atan(l W / v)."""
    use = fast(rows)
    angle = np.arctan2(PAPER.body.wheelbase * rows.yaw_rate[use], rows.speed[use])
    p = PAPER.steering
    gains = (0.8, 1.5, 2.5)
    return Problem(
        "steering", curves.steering, (rows.steering[use],), angle,
        ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"), ("-", "rad", "-", "rad", "-"),
        (0.1, 0.2, -0.1, 0.2, 0.1), (5.0, 0.6, 0.1, 0.6, 5.0), "rad",
        {0: gains, 2: (-0.05, 0.0, 0.05), 4: gains},
        (p.k_left, p.a_left_rad, p.s0, p.a_right_rad, p.k_right),
        needs="rows above 0.8 m/s")
