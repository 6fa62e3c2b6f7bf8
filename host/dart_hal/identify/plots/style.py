"""Colours and frame of all pictures. Needs matplotlib (``pip install dart-hal[plot]``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.identify.fit import Fit
from dart_hal.report import figures
from dart_hal.types import FloatArray

DATA, OURS, PAPER = "#0072b2", "#222222", "#d55e00"
SHADE = "#999999"
PAPER_DASHES = (6, 3)
MANY = 400
"""Points; above it they are drawn small and pale."""


def new_figure(rows: int = 1, columns: int = 1, **options: Any) -> tuple[Any, Any]:
    """(figure, axes). Errors: UsageError when matplotlib is missing."""
    figure = figures.new_figure(options.pop("figsize", (7.2, 4.6)))
    return figure, figure.subplots(rows, columns, **options)


def save(figure: Any, folder: Path, name: str) -> Path:
    """Write ``folder``/``name``.png; the folder is made."""
    return figures.save_figure(figure, folder / f"{name}.png")


def scatter(axes: Any, x: FloatArray, y: FloatArray, label: str, color: str = DATA) -> None:
    """Data points, rasterised so that many of them stay a small file."""
    many = len(x) > MANY
    axes.plot(x, y, ".", ms=2.5 if many else 4.5, alpha=0.25 if many else 0.7, color=color,
              lw=0, rasterized=True, zorder=1)
    axes.plot([], [], ".", ms=7, color=color, lw=0, label=label)  # a legible entry of the legend


def line(axes: Any, x: FloatArray, y: FloatArray, fit: Fit, part: str = "") -> None:
    """Our curve; a fit that is not sound is dotted and said so.

    part: beginning of the names of the parameters that count here, "" = all.
    """
    sound = fit.converged and not any(name.startswith(part) for name in fit.at_bound)
    axes.plot(x, y, color=OURS, lw=2.2, ls="-" if sound else ":", zorder=3,
              label=label(fit) if sound else f"{label(fit)} (not sound)")


def label(fit: Fit) -> str:
    """What the curve of a fit is: no single recording need lie on one of many sessions."""
    sessions = fit.details.get("sessions", 1.0)
    return f"fit, mean of {sessions:g} sessions" if sessions > 1.0 else "fit"


def paper(axes: Any, x: FloatArray, y: FloatArray) -> None:
    """The curve of the paper's code."""
    axes.plot(x, y, color=PAPER, lw=1.5, dashes=PAPER_DASHES, zorder=4, label="paper")


def finish(axes: Any, x: str, y: str, title: str = "") -> None:
    """Labels, grid and legend."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, loc="best")


def values(fit: Fit, *names: str) -> FloatArray:
    """Parameters of a fit as an array, in that order."""
    return np.array([fit.parameters[name].value for name in names])


def limits(*parts: FloatArray, share: float = 0.002) -> tuple[float, float]:
    """Interval of the data without its few wildest points, with a margin."""
    together = np.concatenate(parts)
    low, high = np.quantile(together[np.isfinite(together)], [share, 1.0 - share])
    margin = 0.08 * max(float(high - low), 1e-9)
    return float(low) - margin, float(high) + margin
