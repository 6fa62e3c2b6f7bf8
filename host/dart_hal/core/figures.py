"""Create matplotlib figures in one style: size, colours, axes, legends and file formats.

Needs matplotlib (the extra ``plot``), which is imported here and nowhere else.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray

FIGURE_FORMATS = (".png", ".svg", ".pdf")
# Colours that remain distinguishable in print and for colour-blind readers (Okabe and Ito, 2008).
INK = "#222222"
BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
GREY = "#888888"
# Position of a legend that must not cover data: above the axes.
LEGEND_ABOVE: dict[str, Any] = {"frameon": False, "loc": "lower center",
                                "bbox_to_anchor": (0.5, 1.0)}
# Points; more of them are drawn small and transparent.
MAX_OPAQUE_POINTS = 400


def new_figure(size: tuple[float, float] = (7.2, 4.6), path: str | Path | None = None) -> Any:
    """Create an empty figure of ``size`` [inch]; path: its file, if known.

    Raises UsageError if matplotlib is missing or the suffix unknown.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as err:
        raise UsageError("a plot needs matplotlib", remedy=install_command("plot")) from err
    if path is not None and Path(path).suffix.lower() not in FIGURE_FORMATS:
        raise UsageError(f"no plot format {Path(path).suffix!r}",
                         expected=", ".join(FIGURE_FORMATS))
    return Figure(figsize=size, layout="constrained")


def save_figure(figure: Any, path: str | Path) -> Path:
    """Write the figure, with its folders; the suffix determines the format."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def finish(axes: Any, x: str = "", y: str = "", title: str = "", *, legend: bool = True,
           **placed: Any) -> None:
    """Set labels, title and grid; add the legend if an artist has a label.

    placed: further options of ``axes.legend``.
    """
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, loc="left", fontsize=10)
    axes.grid(alpha=0.3)
    if legend and axes.get_legend_handles_labels()[0]:
        axes.legend(**{"fontsize": 8, "loc": "best", **placed})


def scatter(axes: Any, x: FloatArray, y: FloatArray, label: str, color: str = BLUE) -> None:
    """Draw data points, rasterised so that the file stays small."""
    many = len(x) > MAX_OPAQUE_POINTS
    axes.plot(x, y, ".", ms=2.5 if many else 4.5, alpha=0.25 if many else 0.7, color=color,
              lw=0, rasterized=True, zorder=1)
    axes.plot([], [], ".", ms=7, color=color, lw=0, label=label)  # visible in the legend


def band(axes: Any, x: FloatArray, middle: FloatArray, reach: FloatArray, color: str = BLUE,
         label: str | None = None) -> None:
    """Shade the band ``middle`` +- ``reach`` (n,)."""
    axes.fill_between(x, middle - reach, middle + reach, color=color, alpha=0.2, lw=0, label=label)


def limits(*parts: FloatArray, share: float = 0.002) -> tuple[float, float]:
    """Return the interval of the data without a fraction ``share`` at each end, with a margin."""
    # Quantiles instead of extremes: a few outliers must not determine the scale of the axes.
    together = np.concatenate(parts)
    low, high = np.quantile(together[np.isfinite(together)], [share, 1.0 - share])
    margin = 0.08 * max(float(high - low), 1e-9)
    return float(low) - margin, float(high) + margin
