"""How the noise of a lidar grows with distance, measured from its scans alone.

The second difference of neighbouring distances is nearly zero on a wall, so its spread is that of
the noise, sqrt(6) times. Its median is compared between the near and the far half of each scan:

    variance(r)  =  a^2 + (b r)^2       b: share of the distance
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# m: noise that the constants of matcher and surfels are made for.
NOMINAL_NOISE = 0.015
# Standard deviation of a normal distribution over the median of its absolute value.
STD_OVER_MEDIAN = 1.4826
# Weight of a scan in the mean: 20 scans.
SCAN_WEIGHT = 0.05
# Pairs of neighbours in each half of a scan that are enough for a median.
MIN_PAIRS = 40
# Share that edges and oblique walls may pretend.
MIN_SHARE = 0.004


class RangeNoise:
    """Mean over the scans of one lidar: ``add`` for each."""

    def __init__(self) -> None:
        # Differences, far minus near, of the variance [m2] and of the squared distance [m2].
        self._differences: FloatArray | None = None

    def add(self, distance: FloatArray) -> None:
        """Add the distances (n,) [m] of one scan in order of their angle; NaN without an echo."""
        second = (distance[:-2] - 2.0 * distance[1:-1] + distance[2:]) / np.sqrt(6.0)
        valid = np.isfinite(second)
        r = distance[1:-1][valid]
        spread = np.abs(second[valid])
        if len(r) < 2 * MIN_PAIRS:
            return
        is_far = r > np.median(r)
        if not is_far.any():  # a lidar that repeats one distance
            return
        near, far = ((STD_OVER_MEDIAN * np.median(spread[half]))**2 for half in (~is_far, is_far))
        differences = np.array((far - near, np.mean(r[is_far]**2) - np.mean(r[~is_far]**2)))
        if self._differences is None:
            self._differences = differences
        self._differences += SCAN_WEIGHT * (differences - self._differences)

    @property
    def share(self) -> float:
        """The share of the distance by which the noise grows; 0 if too small to be measured."""
        if self._differences is None or not self._differences[1] > 0.0:
            return 0.0
        share = float(np.sqrt(max(self._differences[0] / self._differences[1], 0.0)))
        return share if share > MIN_SHARE else 0.0

    def spread(self, distance: FloatArray) -> FloatArray:
        """Return the noise at distances (n,) [m] over ``NOMINAL_NOISE``, at least 1."""
        grown: FloatArray = np.hypot(1.0, self.share / NOMINAL_NOISE * distance)
        return grown
