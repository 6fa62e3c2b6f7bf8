"""A fit in a picture: the data, our curve, the paper's curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.core.figures import INK, ORANGE, scatter
from dart_hal.core.types import FloatArray
from dart_lab.identification.fit import Fit

OURS, PAPER = INK, ORANGE
PAPER_DASHES = (6, 3)


def compare(axes: Any, data: tuple[FloatArray, FloatArray], what: str, x: FloatArray, fit: Fit,
            ours: FloatArray, published: FloatArray, *, part: str = "") -> None:
    """Data points (x, y), called ``what``, and both curves at x (n,); part: as in ``line``."""
    scatter(axes, *data, what)
    line(axes, x, ours, fit, part)
    paper(axes, x, published)


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


def values(fit: Fit, *names: str) -> FloatArray:
    """Parameters of a fit as an array, in that order."""
    return np.array([fit.parameters[name].value for name in names])
