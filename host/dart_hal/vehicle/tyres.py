"""Slip angles and lateral tyre forces.

Slip angles are in rad and positive when the tyre force points to the left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.errors import UsageError
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import SLIPS, AxleTyres, Body, PaperTyres

Slip = Callable[[Value, Value, Value, Value, Value], tuple[Value, Value]]
Force = Callable[[Value], Value]


def make_slip(body: Body, xp: Any = math, form: str = "all_speeds") -> Slip:
    """``slip(v_x, v_y, omega, cos d, sin d) -> (alpha_f, alpha_r)`` [rad].

    form: "all_speeds" (the paper's, made valid at rest and in reverse),
    "upstream" (that of the later set, likewise; its regularisation reaches up
    to 1 m/s and belongs to its tyre values), "paper" (as published, v_x > 0
    only). Raises UsageError for another one.
    """
    f = adapt(xp)
    if form == "all_speeds":
        return _regularised(body, f, 0.1, 100.0)
    if form == "upstream":
        return _regularised(body, f, 1.0, 3.0)
    if form == "paper":
        return _paper(body, f)
    raise UsageError(f"no slip angles of form {form!r}", expected=", ".join(SLIPS))


def _regularised(body: Body, f: Any, amount: float, decay: float) -> Slip:
    """Slip angles that are odd in time and zero at rest.

    The paper adds its regularisation to the velocity itself, so that a standing
    car with turned wheels has slip and begins to rotate. Here it only keeps the
    divisor away from zero: |v| + amount exp(-decay v^2). With 0.1, 100 they
    equal the paper's above 0.3 m/s to 1e-4 rad; with 1, 3 upstream's wherever
    the wheels roll forward, exactly.
    """
    l_f, l_r = body.l_f, body.l_r
    atan2, exp, fabs = f.atan2, f.exp, f.fabs

    def slip(vx: Value, vy: Value, om: Value, cd: Value, sd: Value) -> tuple[Value, Value]:
        b = vy + l_f * om
        along = vx * cd + b * sd
        front = atan2(vx * sd - b * cd, fabs(along) + amount * exp(-decay * along * along))
        rear = atan2(l_r * om - vy, fabs(vx) + amount * exp(-decay * vx * vx))
        return front, rear

    return slip


def _paper(body: Body, f: Any) -> Slip:
    l_f, l_r = body.l_f, body.l_r
    atan, atan2, exp = f.atan, f.atan2, f.exp

    def slip(vx: Value, vy: Value, om: Value, cd: Value, sd: Value) -> tuple[Value, Value]:
        v = vx + 0.1 * exp(-100.0 * vx * vx)
        return atan2(sd, cd) - atan2(vy + l_f * om, v), -atan((vy - l_r * om) / v)

    return slip


def make_tyres(p: PaperTyres | AxleTyres, body: Body, xp: Any = math) -> tuple[Force, Force]:
    """``(front, rear)``: lateral force [N] of each axle from its slip angle [rad]."""
    if isinstance(p, AxleTyres):
        return _axle(p, body, adapt(xp))
    return _paper_front(p, adapt(xp)), _paper_rear(p, adapt(xp))


def _paper_front(p: PaperTyres, f: Any) -> Force:
    d, c, b, e = p.front_D, p.front_C, p.front_B, p.front_E
    sin, atan = f.sin, f.atan

    def front(alpha: Value) -> Value:
        x = b * alpha
        return d * sin(c * atan(x - e * (x - atan(x))))

    return front


def _paper_rear(p: PaperTyres, f: Any) -> Force:
    stiffness, limit = p.rear_cornering_stiffness, p.rear_max
    fmin, fmax = f.fmin, f.fmax

    def linear(alpha: Value) -> Value:
        return stiffness * alpha

    def capped(alpha: Value) -> Value:
        return fmax(-limit, fmin(limit, stiffness * alpha))

    # an array or a symbol is not the float inf: it gets the cap
    return linear if isinstance(limit, float) and math.isinf(limit) else capped


def _axle(p: AxleTyres, body: Body, f: Any) -> tuple[Force, Force]:
    sin, atan = f.sin, f.atan
    peak_f, c_f, b_f = p.front_D * body.front_load, p.front_C, p.front_B
    peak_r, c_r, b_r = p.rear_D * body.rear_load, p.rear_C, p.rear_B

    def front(alpha: Value) -> Value:
        return peak_f * sin(c_f * atan(b_f * alpha))

    def rear(alpha: Value) -> Value:
        return peak_r * sin(c_r * atan(b_r * alpha))

    return front, rear
