"""Steering compliance: the force of the front tyres turns the wheels back.

    delta_true = delta - k F_yf

F_yf depends on delta_true in turn: alpha = alpha_rigid / (1 + k F(alpha) / alpha),
three times, and what remains taken as a geometric series: right to a percent of
the change. In reverse the force turns the wheels further; their slip then at
most doubles.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.tyres import make_tyres

ROLLING = 0.1  # m/s; slower than that it is neither forwards nor backwards
NO_SLIP = 1e-8  # rad2
NOTHING = 1e-16  # rad2


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    front, _ = make_tyres(p.tyres, p.body, f)
    l_f = p.body.l_f

    def hook(q: Forces) -> Forces:
        along = q.v_x * q.cos_d + (q.v_y + l_f * q.omega) * q.sin_d
        way = f.tanh(along / ROLLING)
        rigid = q.alpha_f

        def given_way(alpha: Value, force: Value) -> Value:
            stiffness = force * alpha / (alpha * alpha + NO_SLIP)
            return rigid / f.fmax(0.5, 1.0 + k * way * stiffness)

        before = front(rigid)
        once = given_way(rigid, before)
        twice = given_way(once, front(once))
        thrice = given_way(twice, front(twice))
        step, last = twice - once, thrice - twice
        ratio = f.fmax(-0.5, f.fmin(0.5, last * step / (step * step + NOTHING)))
        alpha = thrice + last * ratio / (1.0 - ratio)
        f_yf = front(alpha)
        c, s = f.cos(k * f_yf), f.sin(k * f_yf)
        return q._replace(cos_d=q.cos_d * c + q.sin_d * s, sin_d=q.sin_d * c - q.cos_d * s,
                          alpha_f=alpha, f_yf=q.f_yf + (f_yf - before))

    return hook


EFFECT = Effect(
    name="steering_compliance",
    title="has a steering that gives way to the force of the tyres",
    physics=(
        "Servo, rods and plastic arms are springs: the side force, which acts behind "
        "the steering axis, turns the wheels back towards straight. The faster the "
        "curve, the less the wheels turn."),
    stage="actuator",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "rad/N", 0.0, 0.03, sizes=(0.003, 0.008, 0.02),
                          meaning="angle that the wheels give way per newton of side force"),),
    confused_with=("front_grip", "grip", "steering_gain"),
    experiment=(
        "Circles of the same command at rising speed, then with more load on the front "
        "axle: less curvature as the force rises, but the largest side force stays the "
        "same, where less grip lowers it."),
    force=force,
)
