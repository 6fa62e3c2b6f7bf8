"""Gains of a platoon: how far behind, how stiff, how damped.

Between braking fully and rest lie v_max / |u_min| s and, at standstill, the gap d - h v_D. So

    c = v_max / (d - h v_D)     k = |u_min| / (d - h v_D)

and the headway h is the one at which the slower pole of a follower lies at -k/c, from which on
disturbances fade along the string (in continuous time and without delay).
Source: Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning (tuning of the linear controller).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np

from dart_hal.core.errors import UsageError

# s that are tried, as published: the digits of h come from this grid.
HEADWAYS = np.linspace(0.0, 3.5, 500)


@dataclass(frozen=True, slots=True)
class Gains:
    """d [m]: gap at the speed v_d [m/s]; h [s]: headway; k [1/s2], c [1/s]: of the errors of gap
    and speed; u_min, u_max [m/s2], v_max [m/s]: what a car can do.

    alpha: share of d of which the feed-forward may take back; share, beta: of the feed-forward,
    and of its newest value in a first-order filter, once each control period (1: as told).
    """

    d: float
    v_d: float
    u_min: float
    u_max: float
    v_max: float
    h: float
    k: float
    c: float
    alpha: float = 0.95
    share: float = 1.0
    beta: float = 1.0

    @property
    def rest(self) -> float:
        """Gap [m] at standstill."""
        return self.d - self.h * self.v_d


def tuned(d: float, v_d: float, u_min: float, u_max: float, v_max: float) -> Gains:
    """The published tuning for a gap d [m] at v_d [m/s].

    Raises UsageError where the numbers are those of no platoon.
    """
    if not (d > 0.0 and u_min < 0.0 < u_max and 0.0 < v_d < v_max):
        raise UsageError("no gains for such a platoon",
                         found=f"d {d:g} m, v_d {v_d:g}, v_max {v_max:g} m/s, u {u_min:g} to "
                               f"{u_max:g} m/s2",
                         expected="d > 0, u_min < 0 < u_max, 0 < v_d < v_max")
    h = float(min(HEADWAYS[1:], key=lambda h: abs(_gap_of(h, v_d, u_min, v_max) - d)))
    rest = d - h * v_d
    return Gains(d, v_d, u_min, u_max, v_max, h, abs(u_min) / rest, v_max / rest)


def _gap_of(h: float, v_d: float, u_min: float, v_max: float) -> float:
    """The d [m] for which a headway h [s] lies on the curve; inf: none.

    With r = k/c = |u_min|/v_max the slower root of x^2 - (c + h k) x + k is r iff k = r/h. It is
    the faster one from k < r^2 on.
    """
    r = abs(u_min) / v_max
    k = r / h
    c = k / r
    root = 0.5 * (c + h * k) - 0.5 * sqrt(max((c + h * k) ** 2 - 4.0 * k, 0.0))
    return abs(u_min) / k + h * v_d if abs(root - r) < 1e-9 * r else inf


# The published set of the cars.
DART = tuned(0.5, 1.0, -1.0, 1.0, 1.4)
# The published set of trucks.
TRUCK = tuned(20.0, 25.0, -7.848, 4.905, 100.0 / 3.6)
# With the stiffness of ``DART``: disturbances fade at delays up to 0.2 s, with an acceleration
# that was told up to 0.1 s ago (``stability``); a share of 0.5 needs one that is told now.
STABLE = replace(DART, d=0.6, h=0.4, share=0.3, beta=0.5)
