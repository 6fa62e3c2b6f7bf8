"""Picture: where rolling without slip ends, and where the dynamic model is better."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.core.figures import BLUE, INK, ORANGE, finish, limits, new_figure

from .limit import ToleranceLimit
from .takeover import Takeover
from .validity import TITLES, KinematicLimit

KINEMATIC = ORANGE
DYNAMIC = BLUE
ONE_RECORDING = "#9aa5b1"
ALL_RECORDINGS = INK
DYNAMIC_SHADE = (DYNAMIC, "dynamic better, 95 %")
KINEMATIC_SHADE = (KINEMATIC, "kinematic better, 95 %")
LABELS = {"lateral_acceleration": "lateral acc. |v omega| [m/s2]", "speed": "speed [m/s]"}
PANEL_UNITS = {"vy": "m/s", "yaw_rate": "rad/s", "position": "m"}


def draw_limit(limit: KinematicLimit) -> Any:
    """Draw the evidence without a model on top, paired errors of both forms below."""
    figure = new_figure((9.4, 9.8))
    grid = figure.add_gridspec(3, 6)
    _draw_evidence(figure.add_subplot(grid[0, :3]), limit.slip, np.degrees(1.0),
                   "slip of the rear axle [deg]", "measured, no model: the rear axle slips")
    _draw_evidence(figure.add_subplot(grid[0, 3:]), limit.curvature, 100.0,
                   "lost curvature [%]", "measured, no model: the path opens at held steering")
    rows = ("lateral_acceleration", "speed")
    gains = [b.gain for t in limit.takeover for b in t.bins]
    shaded = [s for s, shown in ((DYNAMIC_SHADE, any(g.low > 0.0 for g in gains)),
                                 (KINEMATIC_SHADE, any(g.high < 0.0 for g in gains))) if shown]
    for i, t in enumerate(sorted(limit.takeover, key=lambda t: rows.index(t.by))):
        row = rows.index(t.by) + 1
        column = 2 * (i % 3)
        _draw_takeover(figure.add_subplot(grid[row, column:column + 2]), t,
                       shaded if i == max(0, len(limit.takeover) - 3) else None)
    figure.suptitle(f"Where the kinematic model ends; below: {limit.model} at the measured speed,\n"
                    "1 s ahead (small figures: windows)", x=0.01, ha="left", fontsize=11)
    return figure


def _draw_evidence(axes: Any, limit: ToleranceLimit, scale: float, label: str, title: str) -> None:
    for c in limit.curves:
        axes.plot(c.bin_values, scale * c.value, color=ONE_RECORDING, lw=0.9, zorder=1)
    axes.plot([], [], color=ONE_RECORDING, lw=0.9, label="one recording")
    if limit.curves:
        axes.plot(limit.bin_means, scale * limit.pooled, "o-", color=ALL_RECORDINGS, lw=2, ms=3,
                  zorder=3, label="median of all")
        known = np.isfinite(limit.band).all(axis=0)
        axes.fill_between(limit.bin_means[known], *(scale * limit.band[:, known]),
                          color=ALL_RECORDINGS, alpha=0.15,
                          lw=0, zorder=2, label="95 % over recordings")
        axes.set_ylim(*limits(scale * np.concatenate([c.value for c in limit.curves]),
                              share=0.03))
    axes.axhline(scale * limit.tolerance, color=KINEMATIC, lw=1.0, ls="--", label="tolerance")
    if np.isfinite(limit.value):
        axes.axvline(limit.value, color=KINEMATIC, lw=1.5)
        if limit.is_supported:
            right = limit.high if np.isfinite(limit.high) else axes.get_xlim()[1]
            axes.axvspan(limit.low, right, color=KINEMATIC, alpha=0.12, lw=0)
    finish(axes, LABELS[limit.by], label, title)


def _draw_takeover(axes: Any, t: Takeover, shaded: list[tuple[str, str]] | None) -> None:
    """Draw one channel; shaded: (colour, label) for the legend, None: no legend."""
    at = [0.5 * (b.low + b.high) for b in t.bins]
    for values, color, label in (([b.kinematic for b in t.bins], KINEMATIC, "kinematic"),
                                 ([b.dynamic for b in t.bins], DYNAMIC, "dynamic")):
        axes.plot(at, values, "o-", color=color, lw=1.8, ms=4, label=label)
    for b, x in zip(t.bins, at, strict=True):
        if b.gain.certain:
            axes.axvspan(b.low, b.high, color=DYNAMIC if b.gain.low > 0.0 else KINEMATIC,
                         alpha=0.10, lw=0)
        axes.annotate(str(b.windows), (x, 1.0), fontsize=8.5, ha="center", va="top",
                      color="#555555", rotation=90, xytext=(0, -2), textcoords="offset points",
                      xycoords=axes.get_xaxis_transform())
    for color, label in shaded or ():
        axes.fill_between([], [], [], color=color, alpha=0.2, label=label)
    axes.set_ylim(0.0, 1.15 * max(max(b.kinematic, b.dynamic) for b in t.bins) if t.bins else 1.0)
    finish(axes, LABELS[t.by], "", f"{TITLES[t.channel]}, RMSE [{PANEL_UNITS[t.channel]}]",
           legend=shaded is not None, fontsize=8.5, loc="upper left", bbox_to_anchor=(0.0, 0.86))
