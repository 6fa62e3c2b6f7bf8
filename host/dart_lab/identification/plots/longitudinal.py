"""Pictures of friction, motor and the response to throttle steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.figures import BLUE, GREY, finish, limits, new_figure
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.sets import PAPER as PUBLISHED
from dart_lab.identification.fit import Fit

from . import style
from .evidence import Coasting, Driving, StepResponse

PAPER_FRICTION = np.array([PUBLISHED.friction.a, PUBLISHED.friction.b, PUBLISHED.friction.c])
PAPER_MOTOR = np.array([PUBLISHED.motor.d, PUBLISHED.motor.e, PUBLISHED.motor.g])
REACHED = 0.99
"""Share of the rows that the picture over throttle covers."""
LEVELS = 7
"""At most so many throttle levels in the motor picture."""


def draw_friction(data: Coasting, fit: Fit) -> Any:
    """Force while coasting over speed."""
    figure = new_figure()
    axes, v = figure.subplots(), np.linspace(0.0, float(data.v.max()), 400)
    style.compare(axes, (data.v, data.force), f"data, throttle 0 ({len(data.v)})", v, fit,
                  *(curves.friction(x, v)[0]
                    for x in (style.values(fit, "a", "b", "c"), PAPER_FRICTION)))
    axes.set_ylim(*limits(data.force))
    a, b, c = (fit.parameters[name] for name in "abc")
    finish(axes, "speed v [m/s]", "force m dv/dt [N]",
           f"Friction: a {a.value:.3f} ± {a.std:.3f} N, b {b.value:.2f} ± {b.std:.2f} s/m, "
           f"c {c.value:.3f} ± {c.std:.3f} N s/m")
    return figure


def draw_motor(data: Driving, fit: Fit) -> Any:
    """Motor force over speed at the throttle levels of the data, and over throttle."""
    import matplotlib

    figure = new_figure((10.4, 4.6))
    left, right = figure.subplots(1, 2)
    x = style.values(fit, "d", "e", "g")
    levels = _levels(data.throttle)
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
    _over_throttle(right, x, data, fit)
    return figure


def _over_throttle(axes: Any, x: FloatArray, data: Driving, fit: Fit) -> None:
    # as far as there are data, but for a few rows: beyond them the curve says nothing
    tau = np.linspace(0.0, float(np.quantile(data.throttle, REACHED)), 300)
    for v in (0.0, 1.0, 2.0):
        speed = np.full(300, v)
        axes.plot(tau, curves.motor(x, tau, speed)[0], color=style.OURS, lw=2.2,
                  alpha=1.0 - 0.3 * v, label=f"fit, {v:.0f} m/s", ls="-" if fit.sound else ":")
        axes.plot(tau, curves.motor(PAPER_MOTOR, tau, speed)[0], color=style.PAPER, lw=1.5,
                  alpha=1.0 - 0.3 * v, dashes=style.PAPER_DASHES, label=f"paper, {v:.0f} m/s")
    told = ", ".join(f"{n} {e.value:.3f} ± {e.std:.3f}" for n, e in fit.parameters.items())
    finish(axes, "throttle behind the gate", "motor force [N]", told)


def _levels(throttle: FloatArray) -> FloatArray:
    """Throttle levels that were held longest, increasing."""
    level, count = np.unique(np.round(throttle[throttle > 0.05], 2), return_counts=True)
    held = level[np.argsort(-count)[:LEVELS]]
    return np.asarray(np.sort(held))


def draw_step(data: StepResponse, friction: Fit | None, motor: Fit | None) -> Any:
    """Velocity and force over the shaded throttle; models driven by the logged throttle."""
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
        v, force = _driven(data, *x)
        kind = "-" if friction.sound and motor.sound else ":"
        label = style.label(motor)
        top.plot(data.t, v, color=style.OURS, lw=1.8, ls=kind, label=label)
        bottom.plot(data.t, force, color=style.OURS, lw=1.8, ls=kind, label=label)
    v, force = _driven(data, PAPER_FRICTION, PAPER_MOTOR)
    style.paper(top, data.t, v)
    style.paper(bottom, data.t, force)
    bottom.set_ylim(*limits(data.force, force))
    finish(top, "", "velocity [m/s]", f"Step response, throttle shaded: {data.title[-44:]}")
    finish(bottom, "time [s]", "force m dv/dt [N]")
    return figure


def _driven(data: StepResponse, friction: FloatArray, motor: FloatArray
            ) -> tuple[FloatArray, FloatArray]:
    """(v, force) (n,) of a model that starts at the data's speed and gets its throttle."""
    mass, fine = PUBLISHED.body.mass, 0.01
    t = np.arange(data.t[0], data.t[-1] + fine, fine)
    held = np.searchsorted(data.t, t, side="right") - 1
    tau = data.throttle[np.maximum(held, 0)]
    v, out = max(float(data.v[0]), 0.0), np.empty((2, len(t)))
    for i in range(len(t)):
        now = np.array([v])
        force = float(curves.friction(friction, now)[0][0]
                      + curves.motor(motor, tau[i:i + 1], now)[0][0])
        out[:, i] = v, force
        v += fine * force / mass
    return np.interp(data.t, t, out[0]), np.interp(data.t, t, out[1])
