"""Conversion of the time stamps of a pose source to the clock of the car."""

from __future__ import annotations

import numpy as np

from dart_hal.core.clock_fit import find_middle_edge, lower_hull
from dart_hal.core.types import FloatArray


def to_car_time(stamp: FloatArray, arrival: FloatArray) -> tuple[FloatArray, str]:
    """Convert the stamps (n,) of a source to the car's clock [s], by offset and rate.

    Both follow from the lower hull of stamps and arrival times (n,). Also returns a warning,
    empty if there is none: if the stamps restart, the arrival times are used instead.
    """
    since = stamp - stamp[0]
    newest = np.maximum.accumulate(since)
    ahead = np.concatenate([[True], newest[1:] > newest[:-1]])
    if np.any(newest - since > 1.0):
        return arrival, ("the pose source restarted its clock: "
                         "arrival times are used instead of its stamps")
    pairs = list(zip(since[ahead].tolist(), arrival[ahead].tolist(), strict=True))
    (xa, ya), (xb, yb) = find_middle_edge(lower_hull(pairs))
    return ya + (yb - ya) / (xb - xa) * (since - xa), ""
