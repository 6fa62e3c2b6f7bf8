"""Coordinates of a fit: its free parameters in prior standard deviations around a base model.

    p = p0 exp(w x)     parameters with a sign by nature (a stiffness, a gain, a dead band): a fit
                        never reaches zero
    p = p0 + w x        offsets and times
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
from dart_hal.vehicle.scale import find_scale

# Prior standard deviations [SI units] of additive parameters of a car of 1:10, by name or group.
# Times are those of servos and do not scale with the car.
PRIOR_AMOUNTS = {"steering.s0": 0.1, "friction.c": 0.3, "delay": 0.1, "tyres.front_E": 2.0}
# Prior standard deviation of the logarithm of all others: a factor of two.
PRIOR_LOG_STD = 0.7
# [SI units] Smaller numbers are rounding errors.
MIN_NUMBER = 1e-9
# [s] Start of a lag that the base model does not have: its derivative at 0 is 0.
FIRST_LAG = 0.04


class Coordinates:
    """x (k,) in prior standard deviations around ``base``; low, high (k,): bounds of x.

    known: standard errors [SI units] by name, where the base was measured; amounts: further
    additive parameters with their prior standard deviations. directions: by name, -1 for a
    parameter that falls with rising x, else 1. Raises UsageError for a parameter
    of the base that is 0 and would be multiplied by a factor.
    """

    def __init__(self, base: Vehicle, names: tuple[str, ...],
                 known: Mapping[str, float] = MappingProxyType({}),
                 amounts: Mapping[str, float] = MappingProxyType({})) -> None:
        self.names = names
        self._vehicle = make_setter(base, names)
        self._start = np.array([value(base, name) for name in names])
        drag = PRIOR_AMOUNTS["friction.c"] * find_scale(base.body).factor("N s/m")
        usual_amounts = {**PRIOR_AMOUNTS, "friction.c": drag, **amounts}
        amount = [usual_amounts.get(n, usual_amounts.get(n.partition(".")[0])) for n in names]
        self._log = np.array([a is None for a in amount])
        zero = [n for n, log, number in zip(names, self._log, self._start, strict=True)
                if log and number == 0.0]
        if zero:
            raise UsageError("a base of 0 cannot be moved by factors", found=", ".join(zero),
                             expected="values other than 0",
                             remedy="--base paper, or a model.toml with a typical value")
        self._whole = np.where(self._log, self._start, 1.0)
        self.directions = dict(zip(names, np.sign(self._whole).tolist(), strict=True))
        usual = [PRIOR_LOG_STD if a is None else a for a in amount]
        scale = np.where(self._log, np.abs(self._start), 1.0)
        self._usual = np.array(usual)
        self._width = np.array([min(w, known[n] / s) if known.get(n, 0.0) > 0.0 and s else w
                                for n, w, s in zip(names, usual, scale.tolist(), strict=True)])
        self._limits = np.reshape([bounds(base, name) for name in names], (-1, 2)).T
        with np.errstate(divide="ignore"):  # the logarithm of a bound at 0
            ends = [np.where(self._log, np.log(np.where(self._log, limit / self._whole, 1.0)),
                             limit - self._start) / self._width for limit in self._limits]
        self.low = np.minimum(*ends)
        self.high = np.maximum(*ends)

    @property
    def first(self) -> FloatArray:
        """Start of the fit (k,): the base, with FIRST_LAG in place of missing lags."""
        return np.array([FIRST_LAG / w if name.endswith("_lag_s") and number == 0.0 else 0.0
                         for name, number, w in zip(self.names, self._start, self._width,
                                                    strict=True)])

    def numbers(self, x: FloatArray) -> FloatArray:
        """Return the parameters (k,) in SI units."""
        numbers = np.where(self._log, self._start * np.exp(self._width * x * self._log),
                           self._start + self._width * x)
        # log and exp may miss a bound, or zero, by one digit.
        return np.asarray(np.clip(np.where(np.abs(numbers) < MIN_NUMBER, 0.0, numbers),
                                  *self._limits))

    def find(self, numbers: FloatArray) -> FloatArray:
        """Return the x (k,) of parameters (k,) in SI units."""
        ratio = np.where(self._log, numbers / np.where(self._log, self._start, 1.0), 1.0)
        return np.asarray(np.where(self._log, np.log(np.maximum(ratio, MIN_NUMBER)),
                                   numbers - self._start) / self._width)

    def slope(self, x: FloatArray) -> FloatArray:
        """Return |d number / d x|, (k,)."""
        return np.where(self._log, self._width * np.abs(self.numbers(x)), self._width)

    def usual(self, x: FloatArray) -> FloatArray:
        """Return the prior standard deviations (k,) [SI units] of unmeasured parameters at x."""
        return np.where(self._log, self._usual * np.abs(self.numbers(x)), self._usual)

    def width(self, i: int) -> float:
        """Return the prior standard deviation of parameter i [SI units] at the base."""
        return float(self._widths[i])

    @cached_property
    def _widths(self) -> FloatArray:
        return self.slope(np.zeros(len(self.names)))

    def vehicle(self, x: FloatArray) -> Vehicle:
        """Return the base with the parameters of x."""
        return self._vehicle(self.numbers(x).tolist())
