"""Matplotlib pictures in one style: size, colours, axes, captions, and where they go.

Needs matplotlib (the extra ``plot``), which is imported here and nowhere else.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray

FORMATS = (".png", ".svg", ".pdf")
INK, BLUE, ORANGE, GREEN, GREY = "#222222", "#0072b2", "#d55e00", "#009e73", "#888888"
"""Colours that are told apart in print and by the colour-blind (Okabe and Ito, 2008)."""
ABOVE: dict[str, Any] = {"frameon": False, "loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
"""Where a legend stands that must not hide data."""
DENSE = 400
"""Points; above it they are drawn small and pale."""


def new_figure(size: tuple[float, float] = (7.2, 4.6), path: str | Path | None = None) -> Any:
    """An empty figure of ``size`` [inch], for ``path`` where it is known.

    Errors: UsageError when matplotlib is missing or the suffix is unknown.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as err:
        raise UsageError("a plot needs matplotlib", remedy=install_command("plot")) from err
    if path is not None and Path(path).suffix.lower() not in FORMATS:
        raise UsageError(f"no plot format {Path(path).suffix!r}", expected=", ".join(FORMATS))
    return Figure(figsize=size, layout="constrained")


def save_figure(figure: Any, path: str | Path) -> Path:
    """Write the figure; folders are made, the suffix picks the format."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def finish(axes: Any, x: str = "", y: str = "", title: str = "", *, legend: bool = True,
           **placed: Any) -> None:
    """Labels, grid and, where something has a label, the legend, ``placed`` as matplotlib says."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(alpha=0.3)
    if legend and axes.get_legend_handles_labels()[0]:
        axes.legend(**{"fontsize": 8, "loc": "best", **placed})


def scatter(axes: Any, x: FloatArray, y: FloatArray, label: str, color: str = BLUE) -> None:
    """Data points, rasterised so that many of them stay a small file."""
    many = len(x) > DENSE
    axes.plot(x, y, ".", ms=2.5 if many else 4.5, alpha=0.25 if many else 0.7, color=color,
              lw=0, rasterized=True, zorder=1)
    axes.plot([], [], ".", ms=7, color=color, lw=0, label=label)  # a legible entry of the legend


def band(axes: Any, x: FloatArray, middle: FloatArray, reach: FloatArray, color: str = BLUE,
         label: str | None = None) -> None:
    """What lies within ``reach`` of ``middle`` (n,), shaded."""
    axes.fill_between(x, middle - reach, middle + reach, color=color, alpha=0.2, lw=0, label=label)


def limits(*parts: FloatArray, share: float = 0.002) -> tuple[float, float]:
    """Interval of the data without its few wildest points, with a margin."""
    together = np.concatenate(parts)
    low, high = np.quantile(together[np.isfinite(together)], [share, 1.0 - share])
    margin = 0.08 * max(float(high - low), 1e-9)
    return float(low) - margin, float(high) + margin
