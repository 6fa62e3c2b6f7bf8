"""Operations that differ between floats and arrays, for formulas of one car or many.

The formulas of this package are written once. ``SCALAR_OPS`` computes with floats and ``math``,
which is fast for one car, ``ARRAY_OPS`` with arrays (n,) of many cars.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.vehicle.namespace import ARRAY, SCALAR, Namespace, Value


@dataclass(frozen=True, slots=True)
class Ops:
    """``f``: functions; ``choose(condition, yes, no)``; ``whole(v)``: floor as an index.

    ``table(values)``: a table for such indices; ``both`` and ``either``: logical operations;
    ``arrays``: the module whose functions take arrays, and those traced by JAX.
    """

    f: Namespace
    choose: Callable[[Any, Value, Value], Value]
    whole: Callable[[Value], Any]
    table: Callable[[Sequence[float]], Any]
    both: Callable[[Any, Any], Any]
    either: Callable[[Any, Any], Any]
    arrays: Any = np

    def __deepcopy__(self, memo: dict[int, Any]) -> Ops:
        """Return the operations themselves: a module has no copy."""
        return self


def _choose(condition: Any, yes: Value, no: Value) -> Value:
    return yes if condition else no


def _indices(values: Value) -> Any:
    return np.floor(values).astype(np.intp)


def _floats(values: Sequence[float]) -> list[float]:
    return [float(v) for v in values]


SCALAR_OPS = Ops(SCALAR, _choose, math.floor, _floats, lambda a, b: a and b, lambda a, b: a or b)
ARRAY_OPS = Ops(ARRAY, np.where, _indices, lambda v: np.asarray(v, dtype=np.float64),
                np.logical_and, np.logical_or)
