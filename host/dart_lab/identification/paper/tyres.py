"""Tyres (folder 50) with the paper's preprocessing and its hand settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import PaperTyres
from dart_hal.vehicle.sets import PAPER, PER_DEGREE
from dart_hal.vehicle.steering import make_steering
from dart_lab.identification.filters import delay_values, slope, smooth

from .folders import JoinedRows
from .problem import CurveProblem

# [s] Delays and yaw offset that the paper set by hand.
STEERING_DELAY = 0.14
POSE_DELAY = 0.1
YAW_OFFSET = math.radians(-0.95)
# The paper's tyre fit shifts its own steering map by 1.5 s0, without mentioning it.
S0_FACTOR = 1.5
# [s] Used interval of sensor time.
FROM_TIME = 5.0
TO_TIME = 58.7
FRONT_NAMES = ("front_D", "front_C", "front_B", "front_E")
FRONT_UNITS = ("N", "-", "1/rad", "-")
FRONT_LOW = (1.0, 0.5, 0.01 * PER_DEGREE, -100.0)
FRONT_HIGH = (10.0, 1.5, 5.0 * PER_DEGREE, 0.0)
REAR_NAME = "rear_cornering_stiffness"
REAR_LOW = (0.01 * PER_DEGREE, -0.1)
REAR_HIGH = (PER_DEGREE, 0.1)
NEEDS = f"rows between {FROM_TIME:g} and {TO_TIME:g} s"
B_CANDIDATES = tuple(b * PER_DEGREE for b in (0.1, 0.2, 0.35, 0.7))


@dataclass(frozen=True, slots=True)
class PaperTyreData:
    """Slip angles [rad] and lateral forces [N] in the tyres' frames, (n,) each; used (rows,)."""

    front_slip: FloatArray
    front_force: FloatArray
    rear_slip: FloatArray
    rear_force: FloatArray
    used: BoolArray


def tyre_data(rows: JoinedRows, yaw_offset: float = YAW_OFFSET) -> PaperTyreData:
    """Compute the paper's inverse dynamics: forces from twice differentiated mocap.

    It takes the marker as the centre of mass, the front's share of F_x as one half, and the mean
    over i-9 ... i+10 as centred.
    """
    t = rows.t
    c = rows.columns
    body = PAPER.body
    x, y = (delay_values(t, c[name], POSE_DELAY) for name in ("vicon x", "vicon y"))
    yaw = delay_values(t, np.unwrap(c["vicon yaw"]), POSE_DELAY) + yaw_offset
    vx, vy, omega = (_derivative(t, v) for v in (x, y, yaw))
    v_lon, v_lat = _into_body(yaw, vx, vy)
    a_lon, a_lat = _into_body(yaw, _derivative(t, vx), _derivative(t, vy))
    turn = body.yaw_inertia * _derivative(t, omega)
    shifted = replace(PAPER.steering, s0=S0_FACTOR * PAPER.steering.s0)
    delta = np.asarray(make_steering(shifted,
                                     ARRAY)(delay_values(t, rows.steering, STEERING_DELAY)))
    force_x = 0.5 * body.mass * a_lon
    force_f = (body.l_r * body.mass * a_lat + turn) / body.wheelbase
    force_r = (body.l_f * body.mass * a_lat - turn) / body.wheelbase
    regular = v_lon + 0.1 * np.exp(-100.0 * v_lon**2)
    front = delta - np.arctan2(v_lat + body.l_f * omega, regular)
    rear = -np.arctan((v_lat - body.l_r * omega) / regular)
    elapsed = c["elapsed time sensors"] - c["elapsed time sensors"][0]
    use = (elapsed > FROM_TIME) & (elapsed < TO_TIME)
    force_f = np.cos(delta) * force_f - np.sin(delta) * force_x
    return PaperTyreData(front[use], force_f[use], rear[use], force_r[use], use)


def _derivative(t: FloatArray, values: FloatArray) -> FloatArray:
    return smooth(slope(t, values), 20, 1)


def _into_body(yaw: FloatArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    return cos * x + sin * y, cos * y - sin * x


def front_problem(data: PaperTyreData, name: str = "tyres_front") -> CurveProblem:
    """Make the problem of the front tyre's D, C, B, E."""
    p = _paper_tyres()
    return CurveProblem(
        name, curves.pacejka, (data.front_slip,), data.front_force, FRONT_NAMES, FRONT_UNITS,
                        FRONT_LOW, FRONT_HIGH,
        "N", {1: (0.7, 1.2), 2: B_CANDIDATES, 3: (-15.0, -3.0, 0.0)},
        (p.front_D, p.front_C, p.front_B, p.front_E), needs=NEEDS)


def front_problem_without_e(data: PaperTyreData) -> CurveProblem:
    """Make the problem of D, C, B with E = 0."""
    return CurveProblem(
        "tyres_front_E0", curves.pacejka_without_e, (data.front_slip,), data.front_force,
        FRONT_NAMES[:3], FRONT_UNITS[:3], FRONT_LOW[:3], FRONT_HIGH[:3], "N",
                        {1: (0.7, 1.2), 2: B_CANDIDATES})


def front_problem_tanh(data: PaperTyreData) -> CurveProblem:
    """Make the problem of D tanh(B alpha): as good with two parameters."""
    return CurveProblem(
        "tyres_front_tanh", curves.saturation, (data.front_slip,), data.front_force,
        ("front_D", "front_B"), ("N", "1/rad"), (FRONT_LOW[0], FRONT_LOW[2]),
                        (FRONT_HIGH[0], FRONT_HIGH[2]), "N",
        {1: B_CANDIDATES})


def rear_problem(data: PaperTyreData) -> CurveProblem:
    """Make the problem of the rear axle's cornering stiffness."""
    return CurveProblem(
        "tyres_rear", curves.linear, (data.rear_slip,), data.rear_force, (REAR_NAME,), ("N/rad",),
        REAR_LOW[:1], REAR_HIGH[:1], "N", {}, (_paper_tyres().rear_cornering_stiffness,))


def rear_problem_with_offset(data: PaperTyreData) -> CurveProblem:
    """Make it with an offset of the slip angle, which the paper fits and then drops."""
    return CurveProblem(
        "tyres_rear_offset", curves.linear_with_offset, (data.rear_slip,), data.rear_force,
        (REAR_NAME, "rear_slip_offset"), ("N/rad", "rad"), REAR_LOW, REAR_HIGH, "N",
        {1: (0.0,)})


def _paper_tyres() -> PaperTyres:
    assert isinstance(PAPER.tyres, PaperTyres)
    return PAPER.tyres
