"""Speed of a car before a line at which it has to stop.

    v <= -b T + sqrt(b^2 T^2 + 2 b (line - LINE_MARGIN - s))

The car begins to decelerate by b after T, and still stops before the line.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray

# Deceleration of a car that rolls out without its brake [m/s2]; time from command to wheels, 0.04
# of transport, 0.08 of lag, 0.1 of a sample, and a reserve [s]; margin for a pose error of 1.5 cm
# and 3 cm at the end of a stop [m].
DECELERATION = 0.8
RESPONSE_DELAY = 0.3
LINE_MARGIN = 0.06
# Throttle above the dead band that does not move the car: 0.05 m/s2 of 1.
THROTTLE_TOLERANCE = 0.003


def safe_speed(distance: FloatArray | float) -> FloatArray:
    """Return the largest safe speed [m/s] at a distance [m] before the line."""
    remaining = np.maximum(np.asarray(distance, dtype=float) - LINE_MARGIN, 0.0)
    bt = DECELERATION * RESPONSE_DELAY
    speed: FloatArray = np.sqrt(bt * bt + 2.0 * DECELERATION * remaining) - bt
    return speed


def stopping_distance(speed: float) -> float:
    """Return the distance [m] from a speed [m/s] to the line."""
    return speed * RESPONSE_DELAY + speed * speed / (2.0 * DECELERATION) + LINE_MARGIN


def sendable_throttle(tau: float, onset: float) -> float:
    """Return the throttle to send for that of a plan, whose minimum is the dead band ``onset``.

    Below it the force does not depend on the throttle, and a plan at rest would find no slope to
    start.
    """
    return 0.0 if tau < onset + THROTTLE_TOLERANCE else tau
