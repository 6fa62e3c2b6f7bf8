"""How far the points of a ``FitGraph`` are from its fit."""

from __future__ import annotations

import numpy as np


def distance_from_fit(graph):
    """Median distance of the points from the fit, as a share of their extent."""
    known = np.isfinite(graph.fit_x)
    order = np.argsort(graph.fit_x[known])
    fit = np.interp(graph.x, graph.fit_x[known][order], graph.fit_y[known][order])
    return np.median(np.abs(graph.y - fit)) / np.ptp(graph.y)
