"""First guesses of friction and motor by linear regression of speed differences.

    coasting:  m dv/dt = -a - c v               (above the speed where tanh(b v) is 1)
    driven:    m dv/dt + a + c v = d tau + d g - e v (tau + g)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.submodels.speeds import Speeds

# Samples to each side: differences over 0.4 s.
DIFFERENCE_SPAN = 2
# [s] The throttle must not change from this time before a difference until its end.
CONSTANT_THROTTLE_TIME = 0.2
# [m/s] The dry friction of a car of 1:10 is complete above it.
MIN_GUESS_SPEED = 0.3
# [s/m] of a car of 1:10, [s]. Not guessed.
START_B = 10.0
START_LAG = 0.05
MIN_GUESS_ROWS = 12


def differences(series: Sequence[Speeds]) -> FloatArray:
    """Return rows (tau, v [m/s], dv/dt [m/s2]) at constant throttle, (n, 3)."""
    rows = []
    for s in series:
        i = np.arange(len(s) - 2 * DIFFERENCE_SPAN)
        i = i[s.run[i] == s.run[i + 2 * DIFFERENCE_SPAN]]
        first = s.t[i] - CONSTANT_THROTTLE_TIME
        last = s.t[i + 2 * DIFFERENCE_SPAN]
        a, b = (np.clip(np.searchsorted(s.throttle.t, when, side="right") - 1, 0, None)
                for when in (first, last))
        changes = np.concatenate([[0], np.cumsum(np.diff(s.throttle.value) != 0.0)])
        i = i[changes[a] == changes[b]]
        b = b[changes[a] == changes[b]]
        slope = (s.v[i + 2 * DIFFERENCE_SPAN] - s.v[i]) / (s.t[i + 2 * DIFFERENCE_SPAN] - s.t[i])
        rows.append(np.column_stack([s.throttle.value[b], s.v[i + DIFFERENCE_SPAN], slope]))
    return np.concatenate(rows) if rows else np.zeros((0, 3))


def first_guess(series: Sequence[Speeds], base: Vehicle, mass: float) -> FloatArray:
    """Guess (8,) in the order of STRAIGHT_NAMES; the base's values where data are missing."""
    f = base.friction
    m = base.duty_motor
    scale = find_scale(base.body)
    least = MIN_GUESS_SPEED * scale.speed
    out = np.array([f.a, START_B * scale.factor("s/m"), f.c, m.d, m.e, m.g, 0.0, START_LAG])
    rows = differences(series)
    coast = rows[(rows[:, 0] == 0.0) & (rows[:, 1] > least)]
    if len(coast) >= MIN_GUESS_ROWS:
        a, c = np.linalg.lstsq(np.column_stack([np.ones(len(coast)), coast[:, 1]]),
                               -mass * coast[:, 2], rcond=None)[0]
        out[0] = max(float(a), 0.1 * scale.force)
        out[2] = max(float(c), 0.01 * scale.factor("N s/m"))
    drive = rows[(rows[:, 0] > 0.05) & (rows[:, 1] > least)]
    if len(drive) >= MIN_GUESS_ROWS and np.ptp(drive[:, 0]) > 0.05:
        tau = drive[:, 0]
        v = drive[:, 1]
        force = mass * drive[:, 2] + out[0] + out[2] * v
        shape = np.column_stack([tau, np.ones(len(v)), -v * tau])
        d, dg, e = np.linalg.lstsq(shape, force - m.e * m.g * -v, rcond=None)[0]
        if d > scale.force and -0.4 < dg / d < 0.0:
            out[3:6] = d, max(float(e), 0.1 * scale.factor("N s/m")), dg / d
    return out
