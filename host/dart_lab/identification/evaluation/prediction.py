"""Open-loop prediction of all windows of an evaluation, and its errors.

Arrays of states are (horizons, 6, windows) as in ``prediction.rollout``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction import rollout
from dart_lab.identification.prediction.rollout import Parts, Progress
from dart_lab.identification.prediction.windows import HORIZONS

from .cases import Case

CHANNELS = ("vx", "vy", "yaw_rate", "position", "yaw_deg")
ERROR_UNITS = ("m/s", "m/s", "rad/s", "m", "deg")
HORIZON_OFFSETS = tuple(round(h / SAMPLE) for h in HORIZONS)


def parts(cases: Sequence[Case]) -> Parts:
    """Return recordings and windows in the form of ``prediction.rollout``."""
    return [(c.grid, c.windows.start) for c in cases]


def measured(cases: Sequence[Case], offsets: Sequence[int] = HORIZON_OFFSETS) -> FloatArray:
    """Return the measured states, ``offsets`` samples after each start."""
    return rollout.measured_states(parts(cases), offsets)


def predict(p: Vehicle, cases: Sequence[Case], progress: Progress | None = None,
            apply: rollout.Apply = map, offsets: Sequence[int] = HORIZON_OFFSETS) -> FloatArray:
    """Predict the states ``offsets`` samples after each start.

    progress, apply: as for ``rollout.predict``.
    """
    return rollout.predict(p, parts(cases), offsets, progress=progress, apply=apply)


def kinematic(p: Vehicle) -> Vehicle:
    """Return the car without tyre slip."""
    return replace(p, kind="kinematic")


def dynamic(p: Vehicle) -> Vehicle:
    """Return the car with tyre slip."""
    return replace(p, kind="dynamic")


def predict_ctrv(cases: Sequence[Case]) -> FloatArray:
    """Predict the baseline: ``constant_velocity`` from the measured start of each window."""
    start = measured(cases, (0,))[0]
    return np.stack([constant_velocity(start, t) for t in HORIZONS])


def constant_velocity(start: FloatArray, t: float | FloatArray) -> FloatArray:
    """Predict the states (6, n) after t [s], a number or (n,), at constant velocity (CTRV).

    start (6, n) or (6, 1). v_x, v_y and yaw rate are constant, so the path is a circle: the
    displacement is the integral of the rotated velocity, in closed form.
    """
    x, y, yaw, vx, vy, om = start
    turn = om * t
    small = np.abs(turn) < 1e-6
    safe = np.where(small, 1.0, turn)
    along = np.where(small, 1.0, np.sin(safe) / safe)  # mean cosine of the turn
    across = np.where(small, 0.5 * turn, (1.0 - np.cos(safe)) / safe)
    dx, dy = t * (vx * along - vy * across), t * (vx * across + vy * along)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack(np.broadcast_arrays(x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn,
                                        vx, vy, om))


def errors(predicted: FloatArray, truth: FloatArray) -> FloatArray:
    """Compute errors (horizons, 5, windows) in the order of CHANNELS: prediction - measurement.

    Position is the distance; yaw in degrees, unwrapped. A diverged prediction has infinite errors.
    """
    d = predicted - truth
    out = np.stack([d[:, 3], d[:, 4], d[:, 5], np.hypot(d[:, 0], d[:, 1]), np.degrees(d[:, 2])],
                   axis=1)
    return np.asarray(np.nan_to_num(out, nan=np.inf, posinf=np.inf, neginf=-np.inf))
