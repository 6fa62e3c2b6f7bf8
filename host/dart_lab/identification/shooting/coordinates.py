"""The numbers that a fit moves, each in units of what one expects it to move.

What has a sign by its nature (a stiffness, a gain, a dead band) moves by
factors, so that no fit runs into zero; offsets and times move by amounts.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.flat import bounds, make_setter, value
from dart_hal.vehicle.parameters import Vehicle

AMOUNT = {"steering.s0": 0.1, "friction.c": 0.3, "delay": 0.1}
"""One prior standard deviation in SI units, by name or group."""
FACTOR = 0.7
"""The same of the logarithm of all others: a factor of two."""
ZERO = 1e-9  # of a unit: smaller numbers are rounding
FIRST_LAG = 0.04  # s; where a lag starts that the base model lacks: at 0 it has no slope


class Coordinates:
    """x (k,) in prior standard deviations around ``base``; low, high (k,): bounds of x.

    known: standard errors by name, in SI units, where the base was measured;
    amounts: widths by name of what moves by amounts besides AMOUNT. Raises
    UsageError where the base has a 0 that would have to move by factors.
    """

    def __init__(self, base: Vehicle, names: tuple[str, ...],
                 known: Mapping[str, float] = MappingProxyType({}),
                 amounts: Mapping[str, float] = MappingProxyType({})) -> None:
        self.names, self._vehicle = names, make_setter(base, names)
        self._start = np.array([value(base, name) for name in names])
        usual_amounts = {**AMOUNT, **amounts}
        amount = [usual_amounts.get(n, usual_amounts.get(n.partition(".")[0])) for n in names]
        self._log = np.array([a is None for a in amount])
        zero = [n for n, log, number in zip(names, self._log, self._start, strict=True)
                if log and number == 0.0]
        if zero:
            raise UsageError("a base of 0 cannot be moved by factors", found=", ".join(zero),
                             expected="values other than 0",
                             remedy="--base paper, or a model.toml with a typical value")
        self._whole = np.where(self._log, self._start, 1.0)
        usual = [FACTOR if a is None else a for a in amount]
        scale = np.where(self._log, np.abs(self._start), 1.0)
        self._usual = np.array(usual)
        self._width = np.array([min(w, known[n] / s) if known.get(n, 0.0) > 0.0 and s else w
                                for n, w, s in zip(names, usual, scale.tolist(), strict=True)])
        self._limits = np.reshape([bounds(base, name) for name in names], (-1, 2)).T
        with np.errstate(divide="ignore"):  # the logarithm of a bound at 0
            ends = [np.where(self._log, np.log(np.where(self._log, limit / self._whole, 1.0)),
                             limit - self._start) / self._width for limit in self._limits]
        self.low, self.high = np.minimum(*ends), np.maximum(*ends)

    @property
    def first(self) -> FloatArray:
        """Where to begin (k,): at the base, but with a lag where it has none."""
        return np.array([FIRST_LAG / w if name.endswith("_lag_s") and number == 0.0 else 0.0
                         for name, number, w in zip(self.names, self._start, self._width,
                                                    strict=True)])

    def numbers(self, x: FloatArray) -> FloatArray:
        """Parameters (k,) in SI units."""
        moved = np.where(self._log, self._start * np.exp(self._width * x * self._log),
                         self._start + self._width * x)
        # the way there and back may miss a bound, or nought, by one digit
        return np.asarray(np.clip(np.where(np.abs(moved) < ZERO, 0.0, moved), *self._limits))

    def find(self, numbers: FloatArray) -> FloatArray:
        """The x (k,) of parameters (k,) in SI units."""
        ratio = np.where(self._log, numbers / np.where(self._log, self._start, 1.0), 1.0)
        return np.asarray(np.where(self._log, np.log(np.maximum(ratio, ZERO)),
                                   numbers - self._start) / self._width)

    def slope(self, x: FloatArray) -> FloatArray:
        """Size of d number / d x, (k,)."""
        return np.where(self._log, self._width * np.abs(self.numbers(x)), self._width)

    def usual(self, x: FloatArray) -> FloatArray:
        """Prior standard deviations (k,) in SI units that nothing measured would have, at x."""
        return np.where(self._log, self._usual * np.abs(self.numbers(x)), self._usual)

    def width(self, i: int) -> float:
        """The prior standard deviation of parameter i in its own units, at the base."""
        return float(self._widths[i])

    @cached_property
    def _widths(self) -> FloatArray:
        return self.slope(np.zeros(len(self.names)))

    def vehicle(self, x: FloatArray) -> Vehicle:
        """The base with these parameters."""
        return self._vehicle(self.numbers(x).tolist())
