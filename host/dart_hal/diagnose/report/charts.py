"""The pictures of the report: residuals before and after, staircase of errors, ranking."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dart_hal.diagnose.features import UNITS
from dart_hal.diagnose.result import Diagnosis
from dart_hal.identify.evaluation import CHANNELS as PREDICTED
from dart_hal.types import FloatArray

from . import svg
from .along import SIDES, Along, Column, Means
from .html import Html, el
from .words import CHANNELS, channel, percent, significant, variable

TWO = 2.0
"""Standard errors that a whisker reaches to each side."""
ROW = 17.0
FEW = 6  # steps whose figures stand beside each other without touching
MOST = 24
"""Bars of the ranking; the table below it holds all."""


def before_after(a: Along, what: str, only_before: bool = False) -> Html:
    """Mean residual along a variable, with two standard errors."""
    frame = svg.Frame(svg.around(a.before.x, a.after.x, zero=False),
                      _span(a.before, a.after, zero=True))
    unit = UNITS[a.variable]
    parts = frame.axes(f"{variable(a.variable)}{f' [{unit}]' if unit != '-' else ''}",
                       f"error [{a.column.unit}]")
    parts += _drawn(frame, a.before, "before")
    if not only_before:
        parts += _drawn(frame, a.after, "after")
    return svg.picture(f"{what}: {a.column.words} along {variable(a.variable)}", parts)


def sides(before: Means, after: Means, column: Column, what: str) -> Html:
    """Mean residual in left turns, straight on and in right turns."""
    frame = svg.Frame((-0.5, 2.5), _span(before, after, zero=True))
    parts = frame.axes("direction of the turn", f"error [{column.unit}]", SIDES)
    for shift, means, class_ in ((-0.08, before, "before"), (0.08, after, "after")):
        moved = replace(means, x=means.x + shift)
        parts += _drawn(frame, moved, class_, joined=False)
    return svg.picture(f"{what}: {column.words}, left against right", parts)


def staircase(d: Diagnosis, horizon: str = "1.0") -> list[Html]:
    """By channel, the error of the base, of the refitted base and with each cause."""
    out = []
    for name in PREDICTED:
        errors = [pooled(s.horizons, horizon, name) for s in d.stages]
        held = pooled(d.ctrv, horizon, name)
        if any(math.isfinite(e) for e in errors):
            out.append(_steps(name, np.array(errors), held, horizon))
    return out


def _steps(name: str, errors: FloatArray, held: float, horizon: str) -> Html:
    high = svg.around(errors, np.array([held]))[1]
    frame = svg.Frame((-0.5, len(errors) - 0.5), (0.0, high), height=220.0)
    unit = CHANNELS[name][1]
    parts = frame.axes("step", f"RMSE at {float(horizon):g} s [{unit}]",
                       [str(i) for i in range(len(errors))])
    if math.isfinite(held):
        start, end = frame.at(-0.5, held), frame.at(len(errors) - 0.5, held)
        parts += [svg.line(start, end, "ctrv"),
                  svg.text(end[0] - 4, end[1] - 5, f"CTRV {significant(held)}", "end")]
    x, nothing = np.arange(len(errors), dtype=float), np.full(len(errors), math.nan)
    parts += svg.curve(frame, x, errors, nothing, nothing, "after")
    told = set(range(len(errors))) if len(errors) <= FEW else {0, 1, len(errors) - 1}
    for i, error in enumerate(errors.tolist()):
        if math.isfinite(error) and i in told:
            px, py = frame.at(i, error)
            parts.append(svg.text(px, py - 9, significant(error), "middle"))
    return el("figure", el("figcaption", channel(name)),
              svg.picture(f"RMSE of the {channel(name)} step by step", parts, height=220.0))


def ranking(d: Diagnosis) -> Html:
    """Drop of the loss of every effect alone, on a logarithmic scale."""
    named = {c.effect for c in d.causes}
    shown = sorted(_alone(d).items(), key=lambda e: (-e[1], e[0]))[:MOST]
    top = max((loss for _, loss in shown), default=0.0)
    height = svg.TOP + ROW * len(shown) + svg.BOTTOM
    frame = svg.Frame((0.0, 1.15 * math.log10(max(top, 10.0))), (0.0, 1.0), height=height,
                      left=145.0)
    parts = frame.x_axis("drop of the loss (logarithmic scale)",
                         [f"{10**i:g}" for i in range(int(frame.x[1]) + 1)])
    for i, (effect, loss) in enumerate(shown):
        y = svg.TOP + i * ROW
        end = frame.at(_log(loss), 0.0)[0]
        parts += [svg.bar(frame.left, y + 2, end - frame.left, ROW - 5,
                          "after" if effect in named else "other"),
                  svg.text(frame.left - 6, y + 12, effect, "end"),
                  svg.text(end + 5, y + 12, significant(loss))]
    return svg.picture("Drop of the loss by effect", parts, height=height)


def _alone(d: Diagnosis) -> dict[str, float]:
    """By effect; without a ranking what is known of the causes and the others."""
    found = d.ranking or {**{c.effect: c.loss for c in d.considered},
                          **{c.effect: c.loss for c in d.causes}}
    return {name: loss for name, loss in found.items() if math.isfinite(loss)}


def _log(loss: float) -> float:
    """Below 1, which is nothing at all, there is no bar."""
    return math.log10(max(loss, 1.0))


def pooled(horizons: Mapping[str, Any], horizon: str, name: str, kind: str = "pooled") -> float:
    """One figure of an error table of ``evaluate``; NaN where there is none."""
    value = horizons.get(horizon, {}).get(kind, {}).get(name)
    return float(value) if value is not None else math.nan


def share_gone(a: Along) -> str:
    """How much of the mean square of this residual went away along its variable."""
    return percent(min(max(a.score, 0.0), 1.0))


def _drawn(frame: svg.Frame, m: Means, class_: str, joined: bool = True) -> list[Html]:
    reach = TWO * m.error
    return svg.curve(frame, m.x, m.mean, m.mean - reach, m.mean + reach, class_, joined)


def _span(*means: Means, zero: bool) -> tuple[float, float]:
    reach: Sequence[FloatArray] = [m.mean + s * TWO * np.nan_to_num(m.error)
                                   for m in means for s in (-1.0, 1.0)]
    return svg.around(*reach, zero=zero)
