"""Gains of a platoon: gap, stiffness and damping.

Full braking lasts v_max / |u_min| s, and the gap at standstill is d - h v_D. So

    c = v_max / (d - h v_D)     k = |u_min| / (d - h v_D)

and the headway h is the one at which the slower pole of a follower is at -k/c, from which on
disturbances decay along the string (in continuous time and without delay).
Source: Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning (tuning of the linear controller).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np

from dart_hal.core.errors import UsageError

# Headways that are tried [s], as published: the digits of h depend on this grid.
HEADWAY_GRID = np.linspace(0.0, 3.5, 500)


@dataclass(frozen=True, slots=True)
class PlatoonGains:
    """d [m]: gap at the speed v_d [m/s]; h [s]: headway; k [1/s2], c [1/s]: gains of the errors of
    gap and speed; u_min, u_max [m/s2], v_max [m/s]: limits of a car.

    alpha: part of d that the feed-forward may use; share: factor of the feed-forward; beta: weight
    of its newest value in a first-order filter, once each control period (1: no filter).
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
    def standstill_gap(self) -> float:
        """Gap at standstill [m]."""
        return self.d - self.h * self.v_d


def tune(d: float, v_d: float, u_min: float, u_max: float, v_max: float) -> PlatoonGains:
    """Return the published tuning for a gap d [m] at v_d [m/s].

    Raises UsageError for impossible parameters.
    """
    if not (d > 0.0 and u_min < 0.0 < u_max and 0.0 < v_d < v_max):
        raise UsageError("no gains for such a platoon",
                         found=f"d {d:g} m, v_d {v_d:g}, v_max {v_max:g} m/s, u {u_min:g} to "
                               f"{u_max:g} m/s2",
                         expected="d > 0, u_min < 0 < u_max, 0 < v_d < v_max")
    h = float(min(HEADWAY_GRID[1:], key=lambda h: abs(_gap_for_headway(h, v_d, u_min, v_max) - d)))
    standstill_gap = d - h * v_d
    return PlatoonGains(
        d, v_d, u_min, u_max, v_max, h, abs(u_min) / standstill_gap, v_max / standstill_gap
    )


def _gap_for_headway(h: float, v_d: float, u_min: float, v_max: float) -> float:
    """Return the gap d [m] for which a headway h [s] satisfies the pole condition; inf: none.

    With r = k/c = |u_min|/v_max the slower root of x^2 - (c + h k) x + k is r iff k = r/h. It is
    the faster one from k < r^2 on.
    """
    r = abs(u_min) / v_max
    k = r / h
    c = k / r
    root = 0.5 * (c + h * k) - 0.5 * sqrt(max((c + h * k) ** 2 - 4.0 * k, 0.0))
    return abs(u_min) / k + h * v_d if abs(root - r) < 1e-9 * r else inf


# The published set of the cars.
DART = tune(0.5, 1.0, -1.0, 1.0, 1.4)
# The published set of trucks.
TRUCK = tune(20.0, 25.0, -7.848, 4.905, 100.0 / 3.6)
# With the stiffness of ``DART``: disturbances decay at delays up to 0.2 s, with an acceleration of
# an age up to 0.1 s (``stability``); a share of 0.5 needs a current one.
STABLE = replace(DART, d=0.6, h=0.4, share=0.3, beta=0.5)
