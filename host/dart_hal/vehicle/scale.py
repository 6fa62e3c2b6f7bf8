"""Scale of a car: lengths, speeds and forces over those of the car that thresholds are stated for.

Thresholds, typical sizes of effects and priors are stated for a car of REFERENCE_WHEELBASE and
REFERENCE_MASS. A car of another size that drives by dynamic similarity has

    lengths ~ L,   forces ~ m g,   times ~ sqrt(L / g),   speeds ~ sqrt(L g),   yaw rates ~ 1 / time

and the same angles and accelerations. Both ratios are rounded to powers of two: half and double of
a threshold give the same results (docs/results/policy_sensitivity.md), and so all cars of a class,
such as 1:10, are judged by the same numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

REFERENCE_WHEELBASE = 0.175  # m
REFERENCE_MASS = 1.67  # kg


class SizedBody(Protocol):
    """Anything with wheelbase [m] and mass [kg], as ``Body`` and ``[geometry]`` of a car file."""

    @property
    def wheelbase(self) -> float: ...

    @property
    def mass(self) -> float: ...


@dataclass(frozen=True, slots=True)
class Scale:
    """length, force: of a car, over those of the reference car."""

    length: float = 1.0
    force: float = 1.0

    @property
    def time(self) -> float:
        """Time of a similar motion over that of the reference car."""
        return math.sqrt(self.length)

    @property
    def speed(self) -> float:
        """Speed of a similar motion over that of the reference car."""
        return math.sqrt(self.length)

    @property
    def yaw_rate(self) -> float:
        """Yaw rate of a similar motion over that of the reference car."""
        return 1.0 / self.time

    def factor(self, unit: str) -> float:
        """Return the ratio of a quantity of that unit to the one of the reference car.

        >>> Scale(length=4.0, force=64.0).factor("N s2/m2")
        16.0
        """
        above, _, below = unit.partition("/")
        out = 1.0
        for part, sign in ((above, 1), (below, -1)):
            for symbol, power in re.findall(r"([A-Za-z]+)(\d?)", part):
                size = {"N": self.force, "kg": self.force, "m": self.length, "s": self.time}
                out *= size.get(symbol, 1.0)**(sign * int(power or 1))
        return out


REFERENCE_SCALE = Scale()


def find_scale(body: SizedBody) -> Scale:
    """Return the scale of a car; of a batch, whose sizes are arrays, that of its median."""
    wheelbase, mass = (float(size if isinstance(size, float) else np.median(size))
                       for size in (body.wheelbase, body.mass))
    return scale_of_sizes(wheelbase, mass)


@lru_cache(maxsize=256)
def scale_of_sizes(wheelbase: float, mass: float) -> Scale:
    """Return the scale of a car with that wheelbase [m] and mass [kg]."""
    length, force = (2.0**round(math.log2(ratio)) for ratio in (
        wheelbase / REFERENCE_WHEELBASE, mass / REFERENCE_MASS))
    return Scale(length, force)
