"""Flexible functions of one or two variables: the shapes that a residual may turn out to have.

Half waves for what has an order, whole ones for angles, one level for each side
and for each recording; products of those for pairs. The wavier, the smaller its
prior: a straight line is what costs least.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from types import MappingProxyType

import numpy as np

from dart_hal.core.types import FloatArray

PERIOD = MappingProxyType({"heading": 2.0 * math.pi, "revolution_angle": 1.0})
LEVELS = ("direction", "recording")
WAVES, PAIR_WAVES = 5, 4
DRIVING = ("speed", "steering_angle", "steering_rate", "throttle", "lateral_acceleration",
           "direction")
MIXED = (("x", "y"), ("x", "direction"), ("y", "direction"), ("x", "y", "direction"),
         ("heading", "speed"), ("time", "speed"), ("time", "throttle"), ("time", "steering_angle"),
         ("revolution_angle", "speed"), ("recording", "time"))
"""Sets of more than one variable that a cause could plausibly need, besides pairs of DRIVING."""


def sets(features: Mapping[str, FloatArray]) -> list[tuple[str, ...]]:
    """Sets of variables to try, the small ones first; of the way there are waves alone."""
    several = [*combinations(DRIVING, 2), *MIXED]
    return [*((name,) for name in features if name != "way"),
            *(s for s in several if all(name in features for name in s))]


def basis(features: Mapping[str, FloatArray], along: tuple[str, ...], tail: float,
          waves: int = 0) -> FloatArray:
    """Columns (n, d) of functions of the variables ``along``, without their means.

    features: (n,) by name, finite; tail: quantile beyond which a function is flat; waves: so many
    half waves of each. A
    function of two variables that is a sum of two functions of one is among the products.
    """
    waves = waves or (WAVES if len(along) == 1 else PAIR_WAVES)
    columns, order = np.ones((len(features[along[0]]), 1)), np.zeros(1)
    for name in along:
        more, of = _one(name, features[name], waves, tail)
        columns = (columns[:, :, None] * more[:, None, :]).reshape(len(more), -1)
        order = (order[:, None] + of**2).ravel()
    columns = (columns - columns.mean(axis=0)) / np.sqrt(np.maximum(order, 1.0))
    return np.asarray(columns[:, columns.any(axis=0)])


def _one(name: str, value: FloatArray, waves: int, tail: float
         ) -> tuple[FloatArray, FloatArray]:
    """Functions (n, d) of one variable, the first constant, and how wavy each is (d,)."""
    if name in LEVELS:
        levels = np.unique(value)
        columns = np.column_stack([np.ones(len(value)), value[:, None] == levels])
        return columns, np.append(0.0, np.ones(len(levels)))
    if name in PERIOD:
        turn, k = 2.0 * math.pi / PERIOD[name] * value[:, None], np.arange(1, waves // 2 + 1)
        columns = np.column_stack([np.ones(len(value)), np.cos(turn * k), np.sin(turn * k)])
        return columns, np.concatenate([[0.0], k, k])
    low, high = np.quantile(value, tail), np.quantile(value, 1.0 - tail)
    place = np.clip((value - low) / max(high - low, 1e-12), 0.0, 1.0)
    k = np.arange(waves + 1)
    return np.cos(math.pi * place[:, None] * k), k.astype(np.float64)
