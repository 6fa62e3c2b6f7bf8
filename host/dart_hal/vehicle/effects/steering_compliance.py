"""Steering compliance: the force of the front tyres turns the wheels back.

    delta_true = delta - k F_yf(alpha),     alpha = alpha_rigid - k F_yf(alpha)

alpha is on both sides. The equation is solved by a fixed number of steps, without a branch:

1. Iterate alpha = alpha_rigid / (1 + k F(alpha) / alpha) three times.
2. The remaining steps are taken as a geometric series with the ratio of the last two steps. The
   result is exact to a percent of the change.

In reverse the force turns the wheels further; their slip then at most doubles.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.tyres import make_tyres

MIN_ROLLING_SPEED = 0.1  # m/s, scale of the smooth sign of the speed
# rad2; keep the quotients F / alpha and of two steps finite at zero slip.
SLIP_OFFSET = 1e-8
STEP_OFFSET = 1e-16


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    front, _ = make_tyres(p.tyres, p.body, f)
    l_f = p.body.l_f

    def hook(q: Forces) -> Forces:
        along = q.v_x * q.cos_d + (q.v_y + l_f * q.omega) * q.sin_d
        direction = f.tanh(along / MIN_ROLLING_SPEED)
        rigid = q.alpha_f

        def iterate(alpha: Value, force: Value) -> Value:
            # F / alpha, finite at alpha = 0.
            stiffness = force * alpha / (alpha * alpha + SLIP_OFFSET)
            return rigid / f.fmax(0.5, 1.0 + k * direction * stiffness)

        # 1. Three iterations that start at the slip angle of a rigid steering.
        before = front(rigid)
        once = iterate(rigid, before)
        twice = iterate(once, front(once))
        thrice = iterate(twice, front(twice))
        # 2. Limit of the geometric series that further steps would make.
        step = twice - once
        last = thrice - twice
        ratio = f.fmax(-0.5, f.fmin(0.5, last * step / (step * step + STEP_OFFSET)))
        alpha = thrice + last * ratio / (1.0 - ratio)
        f_yf = front(alpha)
        # 3. Turn the wheels back by k F_yf: cosine and sine of a difference of angles.
        c = f.cos(k * f_yf)
        s = f.sin(k * f_yf)
        return q._replace(cos_d=q.cos_d * c + q.sin_d * s, sin_d=q.sin_d * c - q.cos_d * s,
                          alpha_f=alpha, f_yf=q.f_yf + (f_yf - before))

    return hook


EFFECT = Effect(
    name="steering_compliance",
    title="has a steering that yields to the force of the tyres",
    physics="The side force turns the wheels back, as rods and arms are springs.",
    stage="actuator",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "rad/N", 0.0, 0.03, sizes=(0.003, 0.008, 0.02),
                          meaning="angle by which the wheels yield per newton of side force"),),
    confused_with=("front_grip", "grip", "steering_gain"),
    experiment="Circles at rising speed. The curvature falls, but not the largest side force.",
    force=force,
)
