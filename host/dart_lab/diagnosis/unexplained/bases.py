"""Basis functions of one to three variables, for structure in the residuals.

Half waves (cosines) for ordered variables, whole waves for angles, indicator functions for the
direction and the recording; products of those for several variables. The prior of a function is
smaller for a higher wave number, so a straight line is preferred.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from types import MappingProxyType

import numpy as np

from dart_hal.core.types import FloatArray

PERIODS = MappingProxyType({"heading": 2.0 * math.pi, "revolution_angle": 1.0})
CATEGORICAL = ("direction", "recording")
# Half waves of one variable, and of each of several.
HALF_WAVES = 5
PAIR_HALF_WAVES = 4
DRIVE_VARIABLES = ("speed", "steering_angle", "steering_rate", "throttle", "lateral_acceleration",
           "direction")
# Sets of several variables that a cause may depend on, in addition to pairs of DRIVE_VARIABLES.
OTHER_SETS = (("x", "y"), ("x", "direction"), ("y", "direction"), ("x", "y", "direction"),
         ("heading", "speed"), ("time", "speed"), ("time", "throttle"), ("time", "steering_angle"),
         ("revolution_angle", "speed"), ("recording", "time"))


def list_variable_sets(features: Mapping[str, FloatArray]) -> list[tuple[str, ...]]:
    """List the sets of variables that are tried, single ones first; "way" has only waves."""
    candidates = [*combinations(DRIVE_VARIABLES, 2), *OTHER_SETS]
    return [*((name,) for name in features if name != "way"),
            *(s for s in candidates if all(name in features for name in s))]


def basis_functions(features: Mapping[str, FloatArray], variables: tuple[str, ...], tail: float,
                    half_waves: int = 0) -> FloatArray:
    """Evaluate the basis functions of some variables without their means, (n, d).

    features: (n,) by name, finite. tail: quantile beyond which a function is constant. half_waves:
    number for each variable, 0 for the default. Sums of functions of one variable are among the
    products.
    """
    half_waves = half_waves or (HALF_WAVES if len(variables) == 1 else PAIR_HALF_WAVES)
    columns = np.ones((len(features[variables[0]]), 1))
    order = np.zeros(1)
    for name in variables:
        # Products of all functions so far with those of the next variable; squared orders add.
        functions, waviness = _functions_of_one(name, features[name], half_waves, tail)
        columns = (columns[:, :, None] * functions[:, None, :]).reshape(len(functions), -1)
        order = (order[:, None] + waviness**2).ravel()
    # The prior: amplitudes are divided by the order of the function.
    columns = (columns - columns.mean(axis=0)) / np.sqrt(np.maximum(order, 1.0))
    return np.asarray(columns[:, columns.any(axis=0)])


def _functions_of_one(name: str, value: FloatArray, half_waves: int, tail: float
         ) -> tuple[FloatArray, FloatArray]:
    """Functions (n, d) of one variable, the first constant, and their order (d,)."""
    if name in CATEGORICAL:
        levels = np.unique(value)
        columns = np.column_stack([np.ones(len(value)), value[:, None] == levels])
        return columns, np.append(0.0, np.ones(len(levels)))
    if name in PERIODS:
        phase = 2.0 * math.pi / PERIODS[name] * value[:, None]
        k = np.arange(1, half_waves // 2 + 1)
        columns = np.column_stack([np.ones(len(value)), np.cos(phase * k), np.sin(phase * k)])
        return columns, np.concatenate([[0.0], k, k])
    # Half waves between the quantiles; constant beyond them, where there are few values.
    low = np.quantile(value, tail)
    high = np.quantile(value, 1.0 - tail)
    scaled = np.clip((value - low) / max(high - low, 1e-12), 0.0, 1.0)
    k = np.arange(half_waves + 1)
    return np.cos(math.pi * scaled[:, None] * k), k.astype(np.float64)
