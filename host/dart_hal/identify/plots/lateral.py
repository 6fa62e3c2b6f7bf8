"""Pictures of the steering map, the tyres and the steering delay."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.identify.as_paper import curves
from dart_hal.identify.fit import Fit
from dart_hal.types import FloatArray
from dart_hal.vehicle.parameters import PaperTyres
from dart_hal.vehicle.sets import PAPER as PUBLISHED

from . import style
from .evidence import Lagging, Slipping, Turning

MAP = ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right")
FRONT = ("front_D", "front_C", "front_B", "front_E")
REAR = "rear_cornering_stiffness"


def draw_steering(data: Turning, fit: Fit) -> Any:
    """Road-wheel angle over command."""
    figure, axes = style.new_figure()
    style.scatter(axes, data.command, np.degrees(data.angle),
                  f"data, atan(l W / v) ({len(data.angle)})")
    s = np.linspace(-1.0, 1.0, 401)
    style.line(axes, s, _map_deg(style.values(fit, *MAP), s), fit)
    p = PUBLISHED.steering
    style.paper(axes, s, _map_deg(np.array([getattr(p, name) for name in MAP]), s))
    axes.set_ylim(-27, 27)
    style.finish(axes, "steering command, +1 = full left", "road-wheel angle [deg], + = left",
                 f"Steering map: rmse {np.degrees(fit.rmse):.2f} deg" if fit.unit == "rad"
                 else "Steering map")
    return figure


def _map_deg(x: FloatArray, s: FloatArray) -> FloatArray:
    return np.asarray(np.degrees(curves.steering(x, s)[0]))


def draw_tyres(data: Slipping, fit: Fit) -> Any:
    """Lateral force over slip angle, front and rear."""
    figure, (left, right) = style.new_figure(1, 2, figsize=(10.4, 4.6))
    p = PUBLISHED.tyres
    assert isinstance(p, PaperTyres)
    style.scatter(left, np.degrees(data.front_slip), data.front_force, data.label)
    alpha = np.radians(np.linspace(*style.limits(np.degrees(data.front_slip)), 300))
    ours = curves.pacejka(style.values(fit, *FRONT), alpha)[0]
    style.line(left, np.degrees(alpha), ours, fit, "front")
    published = np.array([getattr(p, name) for name in FRONT])
    style.paper(left, np.degrees(alpha), curves.pacejka(published, alpha)[0])
    left.set_ylim(*style.limits(data.front_force))
    left.set_xlim(*np.degrees(alpha[[0, -1]]))
    style.finish(left, "front slip angle [deg]", "front lateral force [N]", _front_title(fit))
    style.scatter(right, np.degrees(data.rear_slip), data.rear_force, data.label)
    alpha = np.radians(np.linspace(*style.limits(np.degrees(data.rear_slip)), 50))
    stiffness = fit.parameters[REAR]
    style.line(right, np.degrees(alpha), stiffness.value * alpha, fit, "rear")
    style.paper(right, np.degrees(alpha), p.rear_cornering_stiffness * alpha)
    right.set_ylim(*style.limits(data.rear_force))
    right.set_xlim(*np.degrees(alpha[[0, -1]]))
    degree = np.pi / 180.0
    style.finish(right, "rear slip angle [deg]", "rear lateral force [N]",
                 f"Rear: {stiffness.value:.2f} ± {stiffness.std:.2f} N/rad "
                 f"({stiffness.value * degree:.4f} N/deg)")
    return figure


def _front_title(fit: Fit) -> str:
    d, c, b = style.values(fit, *FRONT[:3]).tolist()
    doubt = [name.removeprefix("front_") for name in FRONT if not fit.parameters[name].identifiable]
    told = f"; not told: {', '.join(doubt)}" if doubt else ""
    return f"Front: BCD {b * c * d:.1f} N/rad ({b * c * d * np.pi / 180.0:.3f} N/deg){told}"


def draw_delay(data: Lagging, fit: Fit) -> Any:
    """Agreement of command and yaw rate over the lag."""
    figure, axes = style.new_figure(figsize=(7.2, 4.2))
    dots = len(data.lag) < 40
    axes.plot(data.lag, data.value, "o-" if dots else "-", color=style.DATA, ms=5, lw=1.4,
              label="correlation of command and yaw rate")
    for i, (lag, what) in enumerate(data.marks):
        axes.axvline(lag, color=(style.OURS, style.PAPER, "#009e73")[i % 3], lw=1.6,
                     dashes=((4, 0), (6, 3), (2, 2))[i % 3], label=f"{what}: {lag:.3f} s")
    steering = fit.parameters["steering_s"]
    text = f"± {steering.std:.3f} s" if np.isfinite(steering.std) else "(not told)"
    style.finish(axes, "lag [s]", "correlation, best = 1",
                 f"Steering delay {steering.value:.3f} {text}")
    return figure
