"""Conditions in which the dynamic model predicts better than the kinematic one.

1. Both models are rolled out at the measured speed, so that errors of motor and friction do not
   count: only the turning is predicted.
2. Windows in which the car spins are excluded; the others are binned by lateral acceleration and
   by speed.
3. In each bin the errors are paired, with a bootstrap over recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.process.jobs import each
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.prediction.rollout import (
    batches,
    concatenate_series,
    cut_windows,
    inputs,
)
from dart_lab.identification.prediction.windows import HORIZONS, WINDOW_LENGTH

from .cases import Case
from .compare import MIN_BLOCKS, Gain, gain, label_blocks
from .noslip import MIN_SPIN_SLIP, rear_slip_angle
from .prediction import CHANNELS, HORIZON_OFFSETS, dynamic, errors, kinematic, measured, parts
from .scores import rms

BIN_EDGES = {"lateral_acceleration": np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 8.0]),
             "speed": np.array([0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.6, 3.5])}
TAKEOVER_CHANNELS = ("vy", "yaw_rate", "position")
TAKEOVER_HORIZON = 1.0
MIN_BIN_WINDOWS = 20
HORIZON_SAMPLES = HORIZON_OFFSETS[HORIZONS.index(TAKEOVER_HORIZON)]


@dataclass(frozen=True, slots=True)
class TakeoverBin:
    """Windows with a mean of |v omega| [m/s2] or v_x [m/s] in [low, high), one channel."""

    low: float
    high: float
    windows: int
    kinematic: float
    dynamic: float
    gain: Gain

    def to_json(self) -> dict[str, Any]:
        """RMSE of both models and the gain from the first to the second."""
        return {"low": self.low, "high": self.high, "windows": self.windows,
                "kinematic": self.kinematic, "dynamic": self.dynamic,
                "gain": self.gain.to_json()}


@dataclass(frozen=True, slots=True)
class Takeover:
    """Bins of one channel by one variable, in increasing order."""

    channel: str
    by: str
    bins: tuple[TakeoverBin, ...]

    @property
    def holds_to(self) -> float:
        """Upper edge of the bins in which the dynamic model is not significantly better.

        NaN: it is better (or there are too few data) from the first bin on.
        """
        edge = np.nan
        for b in self.bins:
            if b.gain.low > 0.0 or b.gain.blocks < MIN_BLOCKS:
                break
            edge = b.high
        return float(edge)

    @property
    def taken_from(self) -> float:
        """Lower edge of the bins from which on it is significantly better in all; NaN: none."""
        edge = np.nan
        for b in reversed(self.bins):
            if not b.gain.low > 0.0:
                break
            edge = b.low
        return float(edge)

    def to_json(self) -> dict[str, Any]:
        """Both edges, null where the data do not support one, and the bins."""
        return {"holds_to": self.holds_to, "taken_from": self.taken_from,
                "bins": [b.to_json() for b in self.bins]}


def find_takeover(p: Vehicle, cases: Sequence[Case], seed: int = 0) -> list[Takeover]:
    """Compare the kinematic and the dynamic model with the parameters of ``p``, at 1 s."""
    truth = measured(cases)[HORIZONS.index(TAKEOVER_HORIZON)][None]
    pair = [errors(predict_at_measured_speed(q, cases)[None], truth)[0] for q
            in (kinematic(p), dynamic(p))]
    block, unit = label_blocks(cases)
    out = []
    sound = ~is_spinning(p.body.l_r, cases)
    scale = find_scale(p.body)
    for by, x in mean_conditions(cases).items():
        edges = BIN_EDGES[by] * (scale.speed if by == "speed" else 1.0)
        index = np.where(sound, np.digitize(x, edges) - 1, -1)
        for channel in TAKEOVER_CHANNELS:
            k, d = (e[CHANNELS.index(channel)] for e in pair)
            out.append(Takeover(channel, by, tuple(
                _make_bin(edges[i], edges[i + 1], k[index == i], d[index == i],
                          block[index == i], unit, seed)
                for i in range(len(edges) - 1) if (index == i).sum() >= MIN_BIN_WINDOWS)))
    return out


def mean_conditions(cases: Sequence[Case]) -> dict[str, FloatArray]:
    """Compute means over the horizon, (windows,): |v omega| [m/s2] and v_x [m/s]."""
    accel, at = concatenate_series(parts(cases), [np.abs(c.grid.v_x * c.grid.omega) for c in cases])
    speed, _ = concatenate_series(parts(cases), [c.grid.v_x for c in cases])
    return {"lateral_acceleration": cut_windows(accel, at, HORIZON_SAMPLES).mean(axis=0),
            "speed": cut_windows(speed, at, HORIZON_SAMPLES).mean(axis=0)}


def is_spinning(l_r: float, cases: Sequence[Case]) -> BoolArray:
    """Return whether the rear slips by more than 20 deg anywhere in a window (windows,)."""
    slip, at = concatenate_series(parts(cases), [rear_slip_angle(c.grid, l_r) for c in cases])
    return np.asarray((np.abs(cut_windows(slip, at, WINDOW_LENGTH)) > MIN_SPIN_SLIP).any(axis=0))


def predict_at_measured_speed(p: Vehicle, cases: Sequence[Case]) -> FloatArray:
    """Predict the states (6, windows) after 1 s, with the measured v_x at every sample."""
    throttle, angle, at = inputs(p, parts(cases))
    speed, _ = concatenate_series(parts(cases), [c.grid.v_x for c in cases])
    start = measured(cases, (0,))[0]
    out = np.empty(start.shape)
    work = partial(_predict_batch_at_measured_speed, p, throttle, angle, speed, at, start)
    for some, state in each(work, list(batches(len(at)))):
        out[:, some] = state
    return out


def _predict_batch_at_measured_speed(p: Vehicle, throttle: FloatArray, angle: FloatArray,
                                     speed: FloatArray, first: IntArray, start: FloatArray,
                                     some: slice) -> tuple[slice, FloatArray]:
    """Predict the windows ``some``; the slice with their states."""
    state = start[:, some].copy()  # data of a worker are read-only
    for k in range(HORIZON_SAMPLES):
        now = first[some] + k
        state[3] = speed[now]
        with np.errstate(over="ignore", invalid="ignore"):
            state = rollout(p, state, throttle[now][None], angle[now][None],
                            output_samples=(1,))[0]
    return some, state


def _make_bin(low: float, high: float, k: FloatArray, d: FloatArray, block: Any, unit: str,
              seed: int) -> TakeoverBin:
    return TakeoverBin(float(low), float(high), len(k), float(rms(k)), float(rms(d)),
                       gain(k, d, block, unit, seed))
