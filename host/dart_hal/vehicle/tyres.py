"""Slip angles and lateral tyre forces.

Slip angles are in rad and positive when the tyre force points to the left:

    alpha_f = delta - atan2(v_y + l_f omega, v_x)
    alpha_r = -atan((v_y - l_r omega) / v_x)

Tyre forces, with D the peak, B the stiffness, C the shape and E the curvature factor:

    magic formula, 4 parameters: F_y = D sin(C atan(B alpha - E (B alpha - atan(B alpha))))
    magic formula, 3 parameters: F_y = D F_z sin(C atan(B alpha)),  F_z: static load of the axle
    linear:                      F_y = clip(C_r alpha, -rear_max, rear_max)

Source: H. B. Pacejka, "Tire and Vehicle Dynamics"; forms and values of the DART paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import SLIP_FORMS, AxleTyres, Body, PaperTyres

Slip = Callable[[Value, Value, Value, Value, Value], tuple[Value, Value]]
Force = Callable[[Value], Value]


def make_slip(body: Body, xp: Any = math, form: str = "all_speeds",
              least: Value | None = None) -> Slip:
    """Return ``slip(v_x, v_y, omega, cos d, sin d) -> (alpha_f, alpha_r)`` [rad].

    form: "all_speeds" (the paper's, made valid at rest and in reverse),
    "upstream" (that of the later set, likewise; its regularisation reaches up
    to 1 m/s and belongs to its tyre values), "paper" (as published, v_x > 0
    only). least [m/s]: smallest divisor, see ``min_slip_divisor``; None: as the
    form has it. Raises UsageError for another form.
    """
    f = adapt(xp)
    # amount [m/s] and decay [s2/m2] of the regularisation, see _make_regularised_slip
    if form == "all_speeds":
        return _make_regularised_slip(body, f, 0.1, 100.0, least)
    if form == "upstream":
        return _make_regularised_slip(body, f, 1.0, 3.0, least)
    if form == "paper":
        return _make_paper_slip(body, f, least)
    raise UsageError(f"no slip angles of form {form!r}", expected=", ".join(SLIP_FORMS))


def min_slip_divisor(p: PaperTyres | AxleTyres, body: Body, xp: Any, max_rate: Value) -> Value:
    """Compute the divisor of the slip angles [m/s] at which slip relaxes at ``max_rate`` [1/s].

    At rest of the steering, [v_y, omega] relax at the eigenvalues of

        1/divisor [[(C_f + C_r) / m,          (l_f C_f - l_r C_r) / m      ],
                   [(l_f C_f - l_r C_r) / I_z, (l_f^2 C_f + l_r^2 C_r) / I_z]]

    with C = dF_y / d alpha [N/rad] of an axle: without limit as the divisor, the speed, falls. An
    integrator with a step dt is unstable beyond a rate of some 1/dt. With a divisor of at least
    this size it stays stable. Tyre forces, path and yaw rate of a steady turn stay as they are;
    the car slips sideways faster by (divisor - v) alpha, about a_y dt, which vanishes with the
    step.
    """
    f = adapt(xp)
    front, rear = cornering_stiffness(p, body, f)
    # Larger eigenvalue of that matrix at divisor 1: with its diagonal p, q and the product c of the
    # other two entries it is (p + q + sqrt((p - q)^2 + 4 c)) / 2.
    across = (front + rear) / body.mass
    turning = (body.l_f * body.l_f * front + body.l_r * body.l_r * rear) / body.yaw_inertia
    coupling = body.l_f * front - body.l_r * rear
    difference = across - turning
    coupled = 4.0 * coupling * coupling / (body.mass * body.yaw_inertia)
    return 0.5 * (across + turning + f.sqrt(difference * difference + coupled)) / max_rate


def cornering_stiffness(p: PaperTyres | AxleTyres, body: Body, xp: Any = math
                        ) -> tuple[Value, Value]:
    """Compute dF_y / d alpha [N/rad] of (front, rear) axle, no less than the tyre's largest.

    The magic formula is steepest at 0 for a curvature E above -3. Below, its largest slope is up
    to ((1 - E)/4)^(1/2) times that at 0 (within 18 %, checked numerically down to E = -20).
    """
    if isinstance(p, AxleTyres):
        return (p.front_D * body.front_load * p.front_C * p.front_B,
                p.rear_D * body.rear_load * p.rear_C * p.rear_B)
    f = adapt(xp)
    steeper = f.sqrt(f.fmax(1.0, 0.25 * (1.0 - p.front_E)))
    return p.front_D * p.front_C * p.front_B * steeper, p.rear_cornering_stiffness


def _make_regularised_slip(body: Body, f: Any, amount: float, decay: float,
                 least: Value | None) -> Slip:
    """Slip angles that are odd in time and zero at rest.

    The paper adds its regularisation to the velocity itself, so that a car at rest with turned
    wheels has slip and begins to rotate. Here only the divisor is kept away from zero:

        alpha_f = atan2(v_x sin d - b cos d, |v_w| + amount exp(-decay v_w^2))
        alpha_r = atan2(l_r omega - v_y,     |v_x| + amount exp(-decay v_x^2))

    with b = v_y + l_f omega and v_w = v_x cos d + b sin d, the speed along the front wheel. With
    0.1, 100 they equal the paper's above 0.3 m/s to 1e-4 rad; with 1, 3 they equal upstream's
    exactly wherever the wheels roll forward.
    """
    l_f = body.l_f
    l_r = body.l_r
    atan2 = f.atan2
    exp = f.exp
    fabs = f.fabs
    fmax = f.fmax

    def slip(vx: Value, vy: Value, om: Value, cd: Value, sd: Value) -> tuple[Value, Value]:
        b = vy + l_f * om
        # Velocity of the front axle in the frame of its wheel: along it, and b cos d - v_x sin d to
        # its left. The slip angle has the opposite sign of the latter.
        along = vx * cd + b * sd
        divisor_f = fabs(along) + amount * exp(-decay * along * along)
        divisor_r = fabs(vx) + amount * exp(-decay * vx * vx)
        if least is not None:
            divisor_f = fmax(divisor_f, least)
            divisor_r = fmax(divisor_r, least)
        return atan2(vx * sd - b * cd, divisor_f), atan2(l_r * om - vy, divisor_r)

    return slip


def _make_paper_slip(body: Body, f: Any, least: Value | None) -> Slip:
    """Slip angles as published: v_x + 0.1 exp(-100 v_x^2) in place of v_x; for v_x > 0."""
    l_f = body.l_f
    l_r = body.l_r
    atan = f.atan
    atan2 = f.atan2
    exp = f.exp
    fmax = f.fmax

    def slip(vx: Value, vy: Value, om: Value, cd: Value, sd: Value) -> tuple[Value, Value]:
        v = vx + 0.1 * exp(-100.0 * vx * vx)
        b = vy + l_f * om
        if least is None:
            return atan2(sd, cd) - atan2(b, v), -atan((vy - l_r * om) / v)
        # The same front angle as a difference of two, so that its divisor can be limited.
        front = atan2(v * sd - b * cd, fmax(v * cd + b * sd, least))
        return front, -atan((vy - l_r * om) / fmax(v, least))

    return slip


def make_tyres(p: PaperTyres | AxleTyres, body: Body, xp: Any = math) -> tuple[Force, Force]:
    """Return ``(front, rear)``: lateral force [N] of each axle from its slip angle [rad]."""
    if isinstance(p, AxleTyres):
        return _make_axle_tyres(p, body, adapt(xp))
    return _make_paper_front(p, adapt(xp)), _make_paper_rear(p, adapt(xp))


def _make_paper_front(p: PaperTyres, f: Any) -> Force:
    # Magic formula with the curvature factor E (DART paper, dynamic bicycle model).
    d = p.front_D
    c = p.front_C
    b = p.front_B
    e = p.front_E
    sin = f.sin
    atan = f.atan

    def front(alpha: Value) -> Value:
        x = b * alpha
        return d * sin(c * atan(x - e * (x - atan(x))))

    return front


def _make_paper_rear(p: PaperTyres, f: Any) -> Force:
    # The rear tyre of the paper is linear, as its data do not reach saturation. The limit is an
    # addition.
    stiffness = p.rear_cornering_stiffness
    limit = p.rear_max
    fmin = f.fmin
    fmax = f.fmax

    def linear(alpha: Value) -> Value:
        return stiffness * alpha

    def clip_force(alpha: Value) -> Value:
        return fmax(-limit, fmin(limit, stiffness * alpha))

    # Arrays and symbols always have the limit, whatever their values.
    return linear if isinstance(limit, float) and math.isinf(limit) else clip_force


def _make_axle_tyres(p: AxleTyres, body: Body, f: Any) -> tuple[Force, Force]:
    sin = f.sin
    atan = f.atan
    # The peak is proportional to the static load, so these tyres follow a change of mass or of the
    # centre of mass.
    peak_f = p.front_D * body.front_load
    c_f = p.front_C
    b_f = p.front_B
    peak_r = p.rear_D * body.rear_load
    c_r = p.rear_C
    b_r = p.rear_B

    def front(alpha: Value) -> Value:
        return peak_f * sin(c_f * atan(b_f * alpha))

    def rear(alpha: Value) -> Value:
        return peak_r * sin(c_r * atan(b_r * alpha))

    return front, rear
