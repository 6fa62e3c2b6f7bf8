"""The functions that the equations need, for floats, arrays or symbols.

Every factory of this package takes ``xp``: ``math`` or ``SCALAR`` for one car,
``numpy`` or ``ARRAY`` for many at once, ``casadi`` for an optimiser. The
equations themselves are written once and without branches.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

# A float, an array of them, or a casadi expression: a value of ``xp``.
Value = Any

_ALTERNATIVES = {"atan": "arctan", "atan2": "arctan2", "fmin": "min", "fmax": "max"}


@dataclass(frozen=True, slots=True)
class Namespace:
    """The twelve functions that the equations use."""

    sin: Callable[..., Any]
    cos: Callable[..., Any]
    tan: Callable[..., Any]
    atan: Callable[..., Any]
    atan2: Callable[..., Any]
    tanh: Callable[..., Any]
    exp: Callable[..., Any]
    sqrt: Callable[..., Any]
    fabs: Callable[..., Any]
    floor: Callable[..., Any]
    fmin: Callable[..., Any]
    fmax: Callable[..., Any]


def adapt(xp: Any) -> Namespace:
    """The namespace of a module (``math``, ``numpy``, ``casadi``) or ``xp`` itself.

    ``math`` has no fmin and fmax, older numpy has arctan: this function fills
    the gaps. Raises AttributeError for a module
    that lacks one of the functions.
    """
    if isinstance(xp, Namespace):
        return xp
    return Namespace(**{f.name: _function(xp, f.name) for f in fields(Namespace)})


def _function(xp: Any, name: str) -> Any:
    if hasattr(xp, name):
        return getattr(xp, name)
    other = _ALTERNATIVES.get(name, name)
    if xp is math and hasattr(builtins, other):
        return getattr(builtins, other)
    return getattr(xp, other)


SCALAR = adapt(math)
ARRAY = adapt(np)
