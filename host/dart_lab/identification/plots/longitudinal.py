"""Pictures of friction, motor and the response to throttle steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.figures import BLUE, GREY, finish, limits, new_figure
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.sets import PAPER as PUBLISHED
from dart_lab.identification.fit import SubmodelFit

from . import style
from .evidence import CoastingData, MotorData, StepResponse

PAPER_FRICTION = np.array([PUBLISHED.friction.a, PUBLISHED.friction.b, PUBLISHED.friction.c])
PAPER_MOTOR = np.array([PUBLISHED.duty_motor.d, PUBLISHED.duty_motor.e, PUBLISHED.duty_motor.g])
# The picture over throttle ends at this quantile of the rows.
THROTTLE_QUANTILE = 0.99
# Throttle levels in the motor picture.
MAX_LEVELS = 7


def draw_friction(data: CoastingData, fit: SubmodelFit) -> Any:
    """Draw the force while coasting over the speed."""
    figure = new_figure()
    axes = figure.subplots()
    v = np.linspace(0.0, float(data.v.max()), 400)
    style.compare(axes, (data.v, data.force), f"data, throttle 0 ({len(data.v)})", v, fit,
                  *(curves.friction(x, v)[0]
                    for x in (style.values(fit, "a", "b", "c"), PAPER_FRICTION)))
    axes.set_ylim(*limits(data.force))
    a, b, c = (fit.parameters[name] for name in "abc")
    finish(axes, "speed v [m/s]", "force m dv/dt [N]",
           f"Friction: a {a.value:.3f} ± {a.std:.3f} N, b {b.value:.2f} ± {b.std:.2f} s/m, "
           f"c {c.value:.3f} ± {c.std:.3f} N s/m")
    return figure


def draw_motor(data: MotorData, fit: SubmodelFit) -> Any:
    """Draw the motor force over speed at the throttle levels of the data, and over throttle."""
    import matplotlib

    figure = new_figure((10.4, 4.6))
    left, right = figure.subplots(1, 2)
    x = style.values(fit, "d", "e", "g")
    levels = _throttle_levels(data.throttle)
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, len(levels)))
    for level, colour in zip(levels, colours, strict=True):
        use = np.abs(data.throttle - level) < 0.006
        left.plot(data.v[use], data.force[use], ".", ms=2.5, alpha=0.4, color=colour, lw=0)
        v = np.linspace(0.0, float(data.v[use].max()), 50)
        tau = np.full(50, level)
        left.plot(v, curves.motor(x, tau, v)[0], color=colour, lw=2.2,
                  label=f"throttle {level:.2f}")
        left.plot(v, curves.motor(PAPER_MOTOR, tau, v)[0], color=colour, lw=1.3,
                  dashes=style.PAPER_DASHES)
    left.set_ylim(*limits(data.force))
    finish(left, "speed v [m/s]", "motor force [N]",
           "Motor: dots are data, lines the fit, dashes the paper")
    _draw_over_throttle(right, x, data, fit)
    return figure


def _draw_over_throttle(axes: Any, x: FloatArray, data: MotorData, fit: SubmodelFit) -> None:
    # The curve is not supported by data beyond this throttle.
    tau = np.linspace(0.0, float(np.quantile(data.throttle, THROTTLE_QUANTILE)), 300)
    for v in (0.0, 1.0, 2.0):
        speed = np.full(300, v)
        axes.plot(tau, curves.motor(x, tau, speed)[0], color=style.FIT_COLOR, lw=2.2,
                  alpha=1.0 - 0.3 * v, label=f"fit, {v:.0f} m/s", ls="-" if fit.sound else ":")
        axes.plot(tau, curves.motor(PAPER_MOTOR, tau, speed)[0], color=style.PAPER_COLOR, lw=1.5,
                  alpha=1.0 - 0.3 * v, dashes=style.PAPER_DASHES, label=f"paper, {v:.0f} m/s")
    label = ", ".join(f"{n} {e.value:.3f} ± {e.std:.3f}" for n, e in fit.parameters.items())
    finish(axes, "throttle behind the gate", "motor force [N]", label)


def _throttle_levels(throttle: FloatArray) -> FloatArray:
    """Return the throttle levels with the most rows, in increasing order."""
    level, count = np.unique(np.round(throttle[throttle > 0.05], 2), return_counts=True)
    longest = level[np.argsort(-count)[:MAX_LEVELS]]
    return np.asarray(np.sort(longest))


def draw_step(data: StepResponse, friction: SubmodelFit | None, motor: SubmodelFit | None) -> Any:
    """Draw velocity and force over the shaded throttle, measured and simulated."""
    figure = new_figure((7.2, 5.6))
    top, bottom = figure.subplots(2, 1, sharex=True)
    for axes in (top, bottom):
        shade = axes.twinx()
        shade.fill_between(data.t, 0.0, data.throttle, color=GREY, alpha=0.3, step="post",
                           lw=0)
        shade.set_ylim(0.0, 1.05 * max(float(data.throttle.max()), 0.05))
        shade.set_ylabel("throttle", color="#666666", fontsize=8)
        axes.set_zorder(shade.get_zorder() + 1)
        axes.patch.set_visible(False)
    top.plot(data.t, data.v, ".-", ms=3.5, lw=0.8, color=BLUE, label="data")
    bottom.plot(data.t, data.force, ".-", ms=3.5, lw=0.8, color=BLUE, label="data")
    if friction is not None and motor is not None:
        x = style.values(friction, "a", "b", "c"), style.values(motor, "d", "e", "g")
        v, force = _simulate_step(data, *x)
        kind = "-" if friction.sound and motor.sound else ":"
        label = style.label(motor)
        top.plot(data.t, v, color=style.FIT_COLOR, lw=1.8, ls=kind, label=label)
        bottom.plot(data.t, force, color=style.FIT_COLOR, lw=1.8, ls=kind, label=label)
    v, force = _simulate_step(data, PAPER_FRICTION, PAPER_MOTOR)
    style.paper(top, data.t, v)
    style.paper(bottom, data.t, force)
    bottom.set_ylim(*limits(data.force, force))
    finish(top, "", "velocity [m/s]", f"Step response, throttle shaded: {data.title[-44:]}")
    finish(bottom, "time [s]", "force m dv/dt [N]")
    return figure


def _simulate_step(data: StepResponse, friction: FloatArray, motor: FloatArray
                   ) -> tuple[FloatArray, FloatArray]:
    """Simulate (v, force) (n,) from the data's first speed with its throttle."""
    mass = PUBLISHED.body.mass
    fine = 0.01
    t = np.arange(data.t[0], data.t[-1] + fine, fine)
    row = np.searchsorted(data.t, t, side="right") - 1
    tau = data.throttle[np.maximum(row, 0)]
    v = max(float(data.v[0]), 0.0)
    out = np.empty((2, len(t)))
    for i in range(len(t)):
        now = np.array([v])
        force = float(curves.friction(friction, now)[0][0]
                      + curves.motor(motor, tau[i:i + 1], now)[0][0])
        out[:, i] = v, force
        v += fine * force / mass
    return np.interp(data.t, t, out[0]), np.interp(data.t, t, out[1])
