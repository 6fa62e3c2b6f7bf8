"""The quadratic programme of one Gauss-Newton step, a sum of squares with constraints.

Each term is linear in the variables x: values + slopes x.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np

from dart_hal.control.mpc import admm
from dart_hal.control.mpc.admm import Constraints
from dart_hal.control.mpc.model import DIFFERENCE_STEP
from dart_hal.control.mpc.problem import Condensed
from dart_hal.core.types import FloatArray

Value = Any
# ADMM penalty of the rows of inputs: with 0.1, as in ``mpc``, the price of a slack dominates the
# stops, and 40 iterations from a start far outside the lane do not enforce them.
RHO_INPUT = 1.0


def differentiate(
    f: Callable[..., tuple[Value, ...]], points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Evaluate f and its slopes by finite differences at points (n, m), each column an argument.

    Returns values (n, k) and slopes (n, k, m). All points and differences are one batch.
    """
    m = points.shape[1]
    batch = np.repeat(points.T[:, None, :], 1 + m, axis=1)
    batch[np.arange(m), 1 + np.arange(m)] += DIFFERENCE_STEP
    out = np.array(np.broadcast_arrays(*f(*batch)))
    return out[:, 0].T, ((out[:, 1:] - out[:, :1]) / DIFFERENCE_STEP).transpose(2, 0, 1)


class LeastSquaresProgramme:
    """minimise sum w (values + slopes x)^2, with rows low <= values + slopes x <= high.

    Variables: inputs that move the states (``condensed``), then a slack for each of n stages.
    """

    def __init__(self, condensed: Condensed) -> None:
        self.condensed = condensed
        self.n, _, inputs = condensed.forced.shape
        self.size = inputs + self.n
        self._h = np.zeros((self.size, self.size))
        self._g = np.zeros(self.size)
        self._rows: list[tuple[FloatArray, ...]] = []

    def condense(self, value: FloatArray, by_state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (values (n, k), slopes (n, k, size)) in the variables of the programme.

        value (n, k); by_state (n, k, states or more): slopes to the states, and to other arguments,
        which are ignored.
        """
        by_state = by_state[:, :, :self.condensed.free.shape[1]]
        slopes = np.zeros((*value.shape, self.size))
        slopes[:, :, :-self.n] = by_state @ self.condensed.forced
        return value + (by_state @ self.condensed.free[:, :, None])[:, :, 0], slopes

    def add_squares(
        self, values: FloatArray, slopes: FloatArray, weight: FloatArray | float
    ) -> None:
        """Add rows values (m,), slopes (m, size) to the cost; weight (m,) or one for all."""
        weighted = 2.0 * (slopes.T * weight)
        self._h += weighted @ slopes
        self._g += weighted @ values

    def add_bounds(self, values: FloatArray, slopes: FloatArray, low: FloatArray | float,
                   high: FloatArray | float, rho: float, price: float = inf) -> None:
        """Add rows between low and high, or with a ``price`` for each unit of violation."""
        m = len(values)
        self._rows.append((slopes, low - values, high - values, np.full(m, price), np.full(m, rho)))

    def solve(self, iterations: int, is_late: Callable[[], bool]) -> FloatArray | None:
        """Return x (size,), or None if late."""
        slopes, low, high, price, rho = (
            np.concatenate(part) for part in zip(*self._rows, strict=True)
        )
        return admm.solve(
            self._h, self._g, Constraints(slopes, low, high, price, rho), iterations, is_late
        )
