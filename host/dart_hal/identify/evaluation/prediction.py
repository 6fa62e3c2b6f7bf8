"""Open-loop prediction: from a measured state onwards with the logged commands alone.

All windows of all recordings are rolled out at once, some thousand at a time.
Arrays of states are (horizons, 6, windows): x, y [m], yaw [rad, unwrapped],
v_x, v_y [m/s], yaw rate [rad/s] of the centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dart_hal.identify.commands import actuated
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray, IntArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle

from .cases import Case
from .windows import HORIZONS, LENGTH, SAMPLE

LANES = 2048
"""Windows that are rolled out together: what a core's cache holds, and bounds the memory."""
CHANNELS = ("vx", "vy", "yaw_rate", "position", "yaw_deg")
UNITS = ("m/s", "m/s", "rad/s", "m", "deg")
AT = tuple(round(h / SAMPLE) for h in HORIZONS)
Progress = Callable[[float], None]


def states(g: Grid, samples: IntArray) -> FloatArray:
    """Measured states (6, n) at the samples (n,) of a recording."""
    return np.stack([v[samples] for v in (g.x, g.y, g.yaw, g.v_x, g.v_y, g.omega)])


def measured(cases: Sequence[Case]) -> FloatArray:
    """Measured states at the horizons."""
    return np.stack([np.concatenate([states(c.grid, c.windows.start + k) for c in cases], axis=1)
                     for k in AT])


def starts(cases: Sequence[Case]) -> FloatArray:
    """Measured states (6, windows) from which predictions start."""
    return np.concatenate([states(c.grid, c.windows.start) for c in cases], axis=1)


def joined(cases: Sequence[Case], series: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """(series of all recordings end to end, start (windows,) of each window in it)."""
    lengths = [len(c.grid) for c in cases]
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    return np.concatenate(series), np.concatenate(
        [c.windows.start + offset for c, offset in zip(cases, offsets, strict=False)])


def windowed(series: FloatArray, at: IntArray, samples: int = LENGTH) -> FloatArray:
    """(samples, windows): what windows that start at ``at`` see of a joined series."""
    return np.asarray(series[at[None, :] + np.arange(samples)[:, None]])


def parts(n: int) -> list[slice]:
    """Slices of at most LANES windows."""
    return [slice(a, min(a + LANES, n)) for a in range(0, n, LANES)]


def predict(p: Vehicle, cases: Sequence[Case], progress: Progress | None = None) -> FloatArray:
    """What the model says at the horizons. progress(share) is called as it goes."""
    series = [actuated(p, case.grid) for case in cases]
    throttle, at = joined(cases, [tau for tau, _ in series])
    angle, _ = joined(cases, [delta for _, delta in series])
    start = starts(cases)
    out = np.empty((len(AT), 6, len(at)))
    for part in parts(len(at)):
        with np.errstate(over="ignore", invalid="ignore"):  # a model may diverge: it is scored
            out[:, :, part] = rollout(p, start[:, part], windowed(throttle, at[part]),
                                      windowed(angle, at[part]), at=AT)
        if progress is not None:
            progress(part.stop / len(at))
    return out


def kinematic(p: Vehicle) -> Vehicle:
    """The same car without tyre slip."""
    return replace(p, kind="kinematic")


def dynamic(p: Vehicle) -> Vehicle:
    """The same car on its tyres."""
    return replace(p, kind="dynamic")


def hold(cases: Sequence[Case]) -> FloatArray:
    """The baseline: v_x, v_y and yaw rate stay as they are (CTRV), a circle in closed form."""
    x, y, yaw, vx, vy, om = starts(cases)
    out = np.empty((len(HORIZONS), 6, len(x)))
    for k, t in enumerate(HORIZONS):
        turn = om * t
        small = np.abs(turn) < 1e-6
        safe = np.where(small, 1.0, turn)
        along = np.where(small, 1.0, np.sin(safe) / safe)  # mean of the cosine over the turn
        across = np.where(small, 0.5 * turn, (1.0 - np.cos(safe)) / safe)
        dx, dy = t * (vx * along - vy * across), t * (vx * across + vy * along)
        c, s = np.cos(yaw), np.sin(yaw)
        out[k] = x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn, vx, vy, om
    return out


def errors(predicted: FloatArray, truth: FloatArray) -> FloatArray:
    """(horizons, 5, windows) in the order of CHANNELS: prediction less measurement.

    Position is the distance; yaw in degrees, unwrapped. A prediction that left
    the numbers is infinitely wrong.
    """
    d = predicted - truth
    out = np.stack([d[:, 3], d[:, 4], d[:, 5], np.hypot(d[:, 0], d[:, 1]), np.degrees(d[:, 2])],
                   axis=1)
    return np.asarray(np.nan_to_num(out, nan=np.inf, posinf=np.inf, neginf=-np.inf))
