"""A fit in a picture: data, fitted curve, the paper's curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.core.figures import INK, ORANGE, scatter
from dart_hal.core.types import FloatArray
from dart_lab.identification.fit import SubmodelFit

FIT_COLOR = INK
PAPER_COLOR = ORANGE
PAPER_DASHES = (6, 3)


def compare(axes: Any, data: tuple[FloatArray, FloatArray], what: str, x: FloatArray,
            fit: SubmodelFit, ours: FloatArray, published: FloatArray, *, part: str = "") -> None:
    """Draw data points (x, y) with label ``what``, and both curves; part: as in ``line``."""
    scatter(axes, *data, what)
    line(axes, x, ours, fit, part)
    paper(axes, x, published)


def line(axes: Any, x: FloatArray, y: FloatArray, fit: SubmodelFit, part: str = "") -> None:
    """Draw the fitted curve; a fit that is not sound is dotted and labelled so.

    part: prefix of the parameters that count here, "" = all.
    """
    sound = fit.converged and not any(name.startswith(part) for name in fit.at_bound)
    axes.plot(x, y, color=FIT_COLOR, lw=2.2, ls="-" if sound else ":", zorder=3,
              label=label(fit) if sound else f"{label(fit)} (not sound)")


def label(fit: SubmodelFit) -> str:
    """Return the label of a fit: a recording need not be on the mean of several sessions."""
    sessions = fit.details.get("sessions", 1.0)
    return f"fit, mean of {sessions:g} sessions" if sessions > 1.0 else "fit"


def paper(axes: Any, x: FloatArray, y: FloatArray) -> None:
    """Draw the curve of the paper's code."""
    axes.plot(x, y, color=PAPER_COLOR, lw=1.5, dashes=PAPER_DASHES, zorder=4, label="paper")


def values(fit: SubmodelFit, *names: str) -> FloatArray:
    """Return parameters of a fit as an array, in that order."""
    return np.array([fit.parameters[name].value for name in names])
