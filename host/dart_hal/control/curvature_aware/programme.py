"""The quadratic programme of one Gauss-Newton step, summed up of squares and rows.

Each term is a row of numbers that are linear in the variables x: at + by x.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np

from dart_hal.control.mpc.admm import Rows, solve
from dart_hal.control.mpc.model import SLOPE
from dart_hal.control.mpc.problem import Condensed
from dart_hal.core.types import FloatArray

Value = Any
# Of the rows of inputs: with 0.1, as in ``mpc``, the price of a slack outweighs the stops, and 40
# iterations from a start far outside the lane do not hold them.
RHO_INPUT = 1.0


def slopes(f: Callable[..., tuple[Value, ...]], at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """f at the rows of ``at`` (n, m), each column an argument: values (n, k), slopes (n, k, m).

    All rows and all differences are lanes of one evaluation.
    """
    m = at.shape[1]
    lanes = np.repeat(at.T[:, None, :], 1 + m, axis=1)
    lanes[np.arange(m), 1 + np.arange(m)] += SLOPE
    out = np.array(np.broadcast_arrays(*f(*lanes)))
    return out[:, 0].T, ((out[:, 1:] - out[:, :1]) / SLOPE).transpose(2, 0, 1)


class Programme:
    """minimise sum w (at + by x)^2, with rows low <= at + by x <= high.

    Variables: inputs that move the states (``moved``), then a slack for each of n stages.
    """

    def __init__(self, moved: Condensed) -> None:
        self.moved = moved
        self.n, _, inputs = moved.forced.shape
        self.size = inputs + self.n
        self._h = np.zeros((self.size, self.size))
        self._g = np.zeros(self.size)
        self._rows: list[tuple[FloatArray, ...]] = []

    def through(self, value: FloatArray, by_state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(at (n, k), by (n, k, size)) of values (n, k) and their slopes (n, k, states or more, of
        which the first are the states)."""
        by_state = by_state[:, :, :self.moved.free.shape[1]]
        by = np.zeros((*value.shape, self.size))
        by[:, :, :-self.n] = by_state @ self.moved.forced
        return value + (by_state @ self.moved.free[:, :, None])[:, :, 0], by

    def squares(self, at: FloatArray, by: FloatArray, weight: FloatArray | float) -> None:
        """Add rows at (m,), by (m, size) to the cost; weight (m,) or one for all."""
        weighted = 2.0 * (by.T * weight)
        self._h += weighted @ by
        self._g += weighted @ at

    def bound(self, at: FloatArray, by: FloatArray, low: FloatArray | float,
              high: FloatArray | float, rho: float, price: float = inf) -> None:
        """Add rows that stay between low and high, or pay ``price`` for each unit beyond."""
        m = len(at)
        self._rows.append((by, low - at, high - at, np.full(m, price), np.full(m, rho)))

    def solved(self, iterations: int, late: Callable[[], bool]) -> FloatArray | None:
        """x (size,); None where late."""
        by, low, high, price, rho = (np.concatenate(part) for part in zip(*self._rows, strict=True))
        return solve(self._h, self._g, Rows(by, low, high, price, rho), iterations, late)
