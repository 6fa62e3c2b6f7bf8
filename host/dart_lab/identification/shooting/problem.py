"""Windows of recordings with their measured start, and the model's prediction of them.

Measured velocities are derivatives of measured poses over 0.15 s. Predicted velocities are
derivatives of the predicted poses over the same time: else the fit would have to explain the
smoothing by a slower steering and a larger yaw inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Grid, turning_share
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.rollout import Parts, measured_states, predict
from dart_lab.identification.prediction.windows import MIN_WINDOW_SPEED, find_windows, is_forward

CHANNELS = ("v_x", "v_y", "omega")
PREDICTED_UNITS = ("m/s", "m/s", "rad/s")
# [s] Length of a window.
PREDICTION_TIME = 1.0
# [s] From start to start: every sample is predicted twice.
START_INTERVAL = 0.5
# [s] Read-outs after the start.
READ_TIMES = (0.1, 0.25, 0.5, 0.75, 1.0)
READ_OFFSETS = tuple(round(t / SAMPLE) for t in READ_TIMES)


@dataclass(frozen=True, slots=True)
class ShootingProblem:
    """n windows of some recordings.

    parts: recordings with the first samples of their windows; measured (len(READ_TIMES), 3, n):
    measured CHANNELS; waits [s]: standard error of how long the commands of each recording wait,
    () = none; braked: windows that were left out because the ESC brakes in them.
    """

    parts: Parts
    measured: FloatArray
    waits: tuple[float, ...] = ()
    braked: int = 0

    @classmethod
    def from_grids(cls, grids: Sequence[Grid], every: float = START_INTERVAL) -> ShootingProblem:
        """Find all good windows, one every ``every`` [s]. Raises RecordingError without any."""
        last = [READ_OFFSETS[-1] + g.points // 2 for g in grids]
        starts = [find_windows(g, round(every / SAMPLE), end, end).start
                  for g, end in zip(grids, last, strict=True)]
        fast = [first[_stays_fast(g, first)] for g, first in zip(grids, starts, strict=True)]
        parts = [(g, first[is_forward(g, first, end)])
                 for g, first, end in zip(grids, fast, last, strict=True)]
        braked = sum(map(len, fast)) - sum(len(first) for _, first in parts)
        if not any(len(first) for _, first in parts):
            raise RecordingError(
                "no stretch of these recordings can be predicted",
                found=f"{len(grids)} recording(s) without {PREDICTION_TIME} s of good motion "
                      f"capture above {MIN_WINDOW_SPEED * grids[0].scale.speed:.2g} m/s"
                      + (f" in which the ESC does not brake ({braked} in which it does)"
                         if braked else ""),
                expected="motion capture of a car that is driven forward",
                remedy="dart-hal data check FILES says what is wrong with them")
        return cls(parts, measured_states(parts, READ_OFFSETS)[:, 3:], braked=braked)

    def __len__(self) -> int:
        return int(self.measured.shape[-1])

    def frame_errors(self, which: int) -> FloatArray:
        """Standard error (n,) of L_x [m] (0), theta [rad] (1), L_y [m] (2) of each window's
        marker frame; 0 where it is not known."""
        errors = [0.0 if g.reference.std is None or not np.isfinite(g.reference.std[which])
                  else g.reference.std[which] for g, _ in self.parts]
        return np.repeat(errors, [len(first) for _, first in self.parts])

    def predict(self, p: Vehicle, shift: float = 0.0) -> FloatArray:
        """Predict CHANNELS at READ_TIMES, (len(READ_TIMES), 3, n), as derivatives of poses.

        Samples hold the mean of a lag's output, which is continuous down to a lag of 0.
        shift [m]: of the model's centre of mass ahead of that of the measured motion. The
        prediction is that of the measured point: v_y there is v_y - shift omega.
        """
        parts = self.parts if not shift else [
            (replace(g, v_y=g.v_y + shift * g.omega), first) for g, first in self.parts]
        by_points: dict[int, list[int]] = {}
        for i, (g, _) in enumerate(parts):
            by_points.setdefault(g.points, []).append(i)
        ends = np.cumsum([0, *(len(first) for _, first in parts)])
        out = np.empty(self.measured.shape)
        for points, members in by_points.items():
            columns = np.concatenate([np.arange(ends[i], ends[i + 1]) for i in members])
            out[:, :, columns] = _predict_velocities(p, [parts[i] for i in members], points)
        if shift:
            out[:, 1] -= shift * out[:, 2]
        return out


def _predict_velocities(p: Vehicle, parts: Parts, points: int) -> FloatArray:
    """Predict CHANNELS at READ_TIMES, (len(READ_TIMES), 3, n), as derivatives over ``points``."""
    half = points // 2
    near = np.arange(-half, half + 1)
    at = np.add.outer(READ_OFFSETS, near).ravel()
    # Over 25 points the first derivative reaches samples before the start, which are measured.
    states = predict(p, parts, at[at >= 0].tolist(), smooth=True, sampled="mean")
    if (at < 0).any():
        states = np.concatenate([measured_states(parts, at[at < 0]), states])
    poses = states.reshape(len(READ_OFFSETS), points, *states.shape[1:])[:, :, :3]
    # The slope of a least-squares line, as ``savgol_derivative``.
    dx, dy, omega = np.einsum("j,rjcn->crn", near / (near @ near) / SAMPLE, poses)
    turned = turning_share(omega, points)
    c = np.cos(poses[:, half, 2]) / turned
    s = np.sin(poses[:, half, 2]) / turned
    return np.stack([c * dx + s * dy, c * dy - s * dx, omega], axis=1)


def _stays_fast(g: Grid, first: IntArray) -> BoolArray:
    """Return whether a window (n,) stays above the speed of a window until its last read-out.

    The measured velocity of a car that comes to rest is smoothed over the stop, and friction at
    rest would have to explain that.
    """
    least = MIN_WINDOW_SPEED * g.scale.speed
    return np.asarray(np.all([g.v_x[first + at] > least for at in READ_OFFSETS], axis=0))
