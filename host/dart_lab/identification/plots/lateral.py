"""Pictures of the steering map, the tyres and the steering delay."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.figures import BLUE, GREEN, finish, limits, new_figure
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import PaperTyres
from dart_hal.vehicle.sets import PAPER as PUBLISHED
from dart_hal.vehicle.sets import PER_DEGREE
from dart_lab.identification.fit import SubmodelFit

from . import style
from .evidence import DelayData, SteeringData, TyreData

MAP_NAMES = ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right")
FRONT_PARAMETERS = ("front_D", "front_C", "front_B", "front_E")
REAR_PARAMETER = "rear_cornering_stiffness"
# Colour and dashes of the lines at the lags.
MARK_STYLES = ((style.FIT_COLOR, (4, 0)), (style.PAPER_COLOR, (6, 3)), (GREEN, (2, 2)))


def draw_steering(data: SteeringData, fit: SubmodelFit) -> Any:
    """Draw the road-wheel angle over the command."""
    figure = new_figure()
    axes = figure.subplots()
    s = np.linspace(-1.0, 1.0, 401)
    published = np.array([getattr(PUBLISHED.steering, name) for name in MAP_NAMES])
    style.compare(axes, (data.command, np.degrees(data.angle)),
                  f"data, atan(l W / v) ({len(data.angle)})", s, fit,
                  *(np.degrees(curves.steering(x, s)[0])
                    for x in (style.values(fit, *MAP_NAMES), published)))
    axes.set_ylim(-27, 27)
    finish(axes, "steering command, +1 = full left", "road-wheel angle [deg], + = left",
           f"Steering map: rmse {np.degrees(fit.rmse):.2f} deg" if fit.unit == "rad"
           else "Steering map")
    return figure


def draw_tyres(data: TyreData, fit: SubmodelFit) -> Any:
    """Draw the lateral force over the slip angle, front and rear."""
    figure = new_figure((10.4, 4.6))
    p = PUBLISHED.tyres
    assert isinstance(p, PaperTyres)
    left, right = figure.subplots(1, 2)
    alpha = _slip_axis(left, data.front_slip, data.front_force)
    published = np.array([getattr(p, name) for name in FRONT_PARAMETERS])
    style.compare(left, (np.degrees(data.front_slip), data.front_force), data.label,
                  np.degrees(alpha), fit, *(curves.pacejka(x, alpha)[0] for x in (
                      style.values(fit, *FRONT_PARAMETERS), published)), part="front")
    finish(left, "front slip angle [deg]", "front lateral force [N]", _front_title(fit))
    stiffness = fit.parameters[REAR_PARAMETER]
    alpha = _slip_axis(right, data.rear_slip, data.rear_force)
    style.compare(right, (np.degrees(data.rear_slip), data.rear_force), data.label,
                  np.degrees(alpha), fit, stiffness.value * alpha,
                  p.rear_cornering_stiffness * alpha, part="rear")
    finish(right, "rear slip angle [deg]", "rear lateral force [N]",
           f"Rear: {stiffness.value:.2f} ± {stiffness.std:.2f} N/rad "
           f"({stiffness.value / PER_DEGREE:.4f} N/deg)")
    return figure


def _slip_axis(axes: Any, slip: FloatArray, force: FloatArray) -> FloatArray:
    """Set the axes to the data; return slip angles (n,) [rad] for a curve across them."""
    across = limits(np.degrees(slip))
    axes.set_xlim(*across)
    axes.set_ylim(*limits(force))
    return np.radians(np.linspace(*across, 300))


def _front_title(fit: SubmodelFit) -> str:
    d, c, b = style.values(fit, *FRONT_PARAMETERS[:3]).tolist()
    unidentified = [name.removeprefix("front_") for name in FRONT_PARAMETERS
                    if not fit.parameters[name].identifiable]
    lost = f"; not identified: {', '.join(unidentified)}" if unidentified else ""
    return f"Front: BCD {b * c * d:.1f} N/rad ({b * c * d / PER_DEGREE:.3f} N/deg){lost}"


def draw_delay(data: DelayData, fit: SubmodelFit) -> Any:
    """Draw the correlation of command and yaw rate over the lag."""
    figure = new_figure((7.2, 4.2))
    axes = figure.subplots()
    dots = len(data.lag) < 40
    axes.plot(data.lag, data.value, "o-" if dots else "-", color=BLUE, ms=5, lw=1.4,
              label="correlation of command and yaw rate")
    for (lag, what), (color, dashes) in zip(data.marks, MARK_STYLES, strict=False):
        axes.axvline(lag, color=color, lw=1.6, dashes=dashes, label=f"{what}: {lag:.3f} s")
    steering = fit.parameters["steering_s"]
    text = f"± {steering.std:.3f} s" if np.isfinite(steering.std) else "(not identified)"
    finish(axes, "lag [s]", "correlation, best = 1",
           f"Steering delay {steering.value:.3f} {text}")
    return figure
