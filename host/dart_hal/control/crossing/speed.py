"""How fast a car may be before a line at which it has to stand.

    v <= -b T + sqrt(b^2 T^2 + 2 b (line - MARGIN - s))

T later it begins to slow down by b, and still stops before the line.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# m/s2: what a car rolls out with, without its brake; s: command to wheels, 0.04 of transport,
# 0.08 of lag, 0.1 of a sample, and some; m: the pose errs by 1.5 cm, the last of a stop by 3.
SLOWS = 0.8
LATE = 0.3
MARGIN = 0.06
# Throttle above the dead band that does not move the car: 0.05 m/s2 of 1.
ONSET = 0.003


def safe_speed(room: FloatArray | float) -> FloatArray:
    """m/s at so many metres before the line."""
    left = np.maximum(np.asarray(room, dtype=float) - MARGIN, 0.0)
    bt = SLOWS * LATE
    speed: FloatArray = np.sqrt(bt * bt + 2.0 * SLOWS * left) - bt
    return speed


def stopping_distance(speed: float) -> float:
    """m from a speed [m/s] to the line."""
    return speed * LATE + speed * speed / (2.0 * SLOWS) + MARGIN


def throttle_at(tau: float, onset: float) -> float:
    """The throttle to send for that of a plan, whose least is the motor's dead band ``onset``:
    below it the force does not change with it, and a plan that stands would see no reason to start.
    """
    return 0.0 if tau < onset + ONSET else tau
