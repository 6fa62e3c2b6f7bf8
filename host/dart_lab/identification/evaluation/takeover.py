"""Where the dynamic model predicts better than the kinematic one, window by window.

Both are given the measured speed, sample by sample, so that a wrong motor or
friction curve does not decide: what is left is the turning. Windows in which
the car spins are left out. Errors are paired and the interval of the gain
comes from a bootstrap over recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.rollout import batches, inputs, joined, windowed
from dart_lab.identification.prediction.windows import HORIZONS, LENGTH

from .cases import Case
from .compare import LEAST_BLOCKS, Gain, blocks, gain
from .noslip import SPUN, slip_of
from .prediction import AT, CHANNELS, dynamic, errors, kinematic, measured, parts
from .scores import rms

EDGES = {"lateral_acceleration": np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 8.0]),
         "speed": np.array([0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.6, 3.5])}
JUDGED = ("vy", "yaw_rate", "position")
HORIZON, LEAST_WINDOWS = 1.0, 20
COUNT = AT[HORIZONS.index(HORIZON)]


@dataclass(frozen=True, slots=True)
class Bin:
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
    bins: tuple[Bin, ...]

    @property
    def holds_to(self) -> float:
        """Upper edge of the bins up to which the dynamic model is not better for certain;
        NaN: it is better (or there are too few data) from the first bin."""
        edge = np.nan
        for b in self.bins:
            if b.gain.low > 0.0 or b.gain.blocks < LEAST_BLOCKS:
                break
            edge = b.high
        return float(edge)

    @property
    def taken_from(self) -> float:
        """Lower edge of the bins from which on it is better for certain, all the way up;
        NaN: no such bin."""
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
    """Kinematic against dynamic model with the parameters of ``p``, at 1 s."""
    truth = measured(cases)[HORIZONS.index(HORIZON)][None]
    pair = [errors(at_measured_speed(q, cases)[None], truth)[0] for q in (kinematic(p), dynamic(p))]
    block, unit = blocks(cases)
    out = []
    sound = ~spun(p.body.l_r, cases)
    for by, x in condition(cases).items():
        index = np.where(sound, np.digitize(x, EDGES[by]) - 1, -1)
        for channel in JUDGED:
            k, d = (e[CHANNELS.index(channel)] for e in pair)
            out.append(Takeover(channel, by, tuple(
                _bin(EDGES[by][i], EDGES[by][i + 1], k[index == i], d[index == i],
                     block[index == i], unit, seed)
                for i in range(len(EDGES[by]) - 1) if (index == i).sum() >= LEAST_WINDOWS)))
    return out


def condition(cases: Sequence[Case]) -> dict[str, FloatArray]:
    """Means over the horizon, (windows,): |v omega| [m/s2] and v_x [m/s]."""
    accel, at = joined(parts(cases), [np.abs(c.grid.v_x * c.grid.omega) for c in cases])
    speed, _ = joined(parts(cases), [c.grid.v_x for c in cases])
    return {"lateral_acceleration": windowed(accel, at, COUNT).mean(axis=0),
            "speed": windowed(speed, at, COUNT).mean(axis=0)}


def spun(l_r: float, cases: Sequence[Case]) -> BoolArray:
    """(windows,): whether the rear slips by more than 20 deg somewhere in the window."""
    slip, at = joined(parts(cases), [slip_of(c.grid, l_r) for c in cases])
    return np.asarray((np.abs(windowed(slip, at, LENGTH)) > SPUN).any(axis=0))


def at_measured_speed(p: Vehicle, cases: Sequence[Case]) -> FloatArray:
    """States (6, windows) after 1 s, v_x set to the measured one at every sample of 10 ms."""
    throttle, angle, at = inputs(p, parts(cases))
    speed, _ = joined(parts(cases), [c.grid.v_x for c in cases])
    out = measured(cases, (0,))[0]
    for some in batches(len(at)):
        state = out[:, some]
        for k in range(COUNT):
            now = at[some] + k
            state[3] = speed[now]
            with np.errstate(over="ignore", invalid="ignore"):
                state = rollout(p, state, throttle[now][None], angle[now][None], at=(1,))[0]
        out[:, some] = state
    return np.asarray(out)


def _bin(low: float, high: float, k: FloatArray, d: FloatArray, block: Any, unit: str,
         seed: int) -> Bin:
    return Bin(float(low), float(high), len(k), float(rms(k)), float(rms(d)),
               gain(k, d, block, unit, seed))
