"""First guesses of friction and motor out of speed differences: crude, and free of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle import Vehicle
from dart_lab.identification.submodels.speeds import Speeds

SPAN = 2  # samples to each side: differences over 0.4 s
SETTLED = 0.2  # s before the first sample of a difference; the throttle must not change
FAST = 0.3  # m/s; above it the dry friction is complete
START_B, START_LAG = 10.0, 0.05  # s/m, s
MIN_ROWS = 12


def differences(series: Sequence[Speeds]) -> FloatArray:
    """Rows (tau, v [m/s], dv/dt [m/s2]) where the throttle stood still, (n, 3)."""
    rows = []
    for s in series:
        i = np.arange(len(s) - 2 * SPAN)
        i = i[s.run[i] == s.run[i + 2 * SPAN]]
        first, last = s.t[i] - SETTLED, s.t[i + 2 * SPAN]
        a, b = (np.clip(np.searchsorted(s.throttle.t, when, side="right") - 1, 0, None)
                for when in (first, last))
        changes = np.concatenate([[0], np.cumsum(np.diff(s.throttle.value) != 0.0)])
        i, b = i[changes[a] == changes[b]], b[changes[a] == changes[b]]
        slope = (s.v[i + 2 * SPAN] - s.v[i]) / (s.t[i + 2 * SPAN] - s.t[i])
        rows.append(np.column_stack([s.throttle.value[b], s.v[i + SPAN], slope]))
    return np.concatenate(rows) if rows else np.zeros((0, 3))


def first_guess(series: Sequence[Speeds], base: Vehicle, mass: float) -> FloatArray:
    """(8,) in the order of ``straight.NAMES``; what the data do not show is the base's."""
    f, m = base.friction, base.motor
    out = np.array([f.a, START_B, f.c, m.d, m.e, m.g, 0.0, START_LAG])
    rows = differences(series)
    coast = rows[(rows[:, 0] == 0.0) & (rows[:, 1] > FAST)]
    if len(coast) >= MIN_ROWS:
        a, c = np.linalg.lstsq(np.column_stack([np.ones(len(coast)), coast[:, 1]]),
                               -mass * coast[:, 2], rcond=None)[0]
        out[0], out[2] = max(float(a), 0.1), max(float(c), 0.01)
    drive = rows[(rows[:, 0] > 0.05) & (rows[:, 1] > FAST)]
    if len(drive) >= MIN_ROWS and np.ptp(drive[:, 0]) > 0.05:
        tau, v = drive[:, 0], drive[:, 1]
        force = mass * drive[:, 2] + out[0] + out[2] * v
        shape = np.column_stack([tau, np.ones(len(v)), -v * tau])
        d, dg, e = np.linalg.lstsq(shape, force - m.e * m.g * -v, rcond=None)[0]
        if d > 1.0 and -0.4 < dg / d < 0.0:
            out[3:6] = d, max(float(e), 0.1), dg / d
    return out
