"""The clock of a source of poses, told by its stamps and the car's times of their arrival."""

from __future__ import annotations

import numpy as np

from dart_hal.core.clock_fit import edge_under_middle, lower_hull
from dart_hal.core.types import FloatArray


def car_time(stamp: FloatArray, arrival: FloatArray) -> tuple[FloatArray, str]:
    """Stamps (n,) of a source on the car's clock [s], by offset and rate of the lower hull.

    Also what is wrong with them, in words: told by their arrivals then; empty: nothing.
    """
    since = stamp - stamp[0]
    newest = np.maximum.accumulate(since)
    ahead = np.concatenate([[True], newest[1:] > newest[:-1]])
    if np.any(newest - since > 1.0):
        return arrival, "the source of the poses began anew: told by their arrival"
    pairs = list(zip(since[ahead].tolist(), arrival[ahead].tolist(), strict=True))
    (xa, ya), (xb, yb) = edge_under_middle(lower_hull(pairs))
    return ya + (yb - ya) / (xb - xa) * (since - xa), ""
