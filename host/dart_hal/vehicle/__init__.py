"""Pure physics of the car: equations once, over any namespace of functions.

Factories bind parameters and functions, and return closures:
``make_dynamic(PAPER, math)`` is fast for one car, ``make_dynamic(PAPER,
numpy)`` takes arrays of cars, ``make_dynamic(PAPER, casadi)`` symbols.
"""

from __future__ import annotations

from dart_hal.core.lazy import read_public_names

# The names are in __init__.pyi: a car that drives needs no compiled kernels.
__getattr__, __dir__, __all__ = read_public_names(__name__, __file__)
