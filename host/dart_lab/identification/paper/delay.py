"""Steering delay (folder 40) by the paper's method: cross-correlation of joined rows."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering
from dart_lab.identification.fit import MAX_TIME_STD, FittedParameter, SubmodelFit

from .folders import MIN_FOLDER_ROWS, JoinedRows, make_too_few_error
from .problems import is_fast

# Number of lags: 0 to 10 rows.
COMPARED_LAGS = 11


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of steering command and response over the lag.

    command, response (n,): delta(s) and atan(l omega / v) [rad] of the rows above 0.8 m/s; value
    (COMPARED_LAGS,): correlation at each lag in rows, 1 at the best; mean_step, median_step [s]
    of these rows; peak: lag of a parabola through the peak [rows].
    """

    command: FloatArray
    response: FloatArray
    value: FloatArray
    mean_step: float
    median_step: float
    peak: float

    @property
    def lag(self) -> int:
        """Best lag [rows]."""
        return int(np.argmax(self.value))

    @property
    def delay(self) -> float:
        """Delay of the paper [s]: best lag times the mean step."""
        return self.lag * self.mean_step


def correlation(rows: JoinedRows) -> Correlation:
    """Cross-correlate command and response.

    Raises RecordingError with fewer than MIN_FOLDER_ROWS rows above 0.8 m/s.
    """
    use = is_fast(rows)
    n = int(use.sum())
    if n < MIN_FOLDER_ROWS:
        raise make_too_few_error("delay", "rows above 0.8 m/s", n)
    command = np.asarray(make_steering(PAPER.steering, ARRAY)(rows.steering[use]))
    response = np.arctan(PAPER.body.wheelbase * rows.yaw_rate[use] / rows.speed[use])
    value = np.array([response[k:] @ command[:n - k] for k in range(COMPARED_LAGS)])
    value /= value.max()
    step = np.diff(rows.t[use])
    return Correlation(command, response, value, float(step.mean()), float(np.median(step)),
                       _vertex(value))


def _vertex(value: FloatArray) -> float:
    """Return the lag at the vertex of the parabola through the best lag and its neighbours."""
    i = int(np.argmax(value))
    if not 0 < i < len(value) - 1:
        return float(i)
    before, best, after = value[i - 1:i + 2].tolist()
    return float(i + 0.5 * (before - after) / (before - 2.0 * best + after))


def fit_delay(rows: JoinedRows) -> tuple[SubmodelFit, Correlation]:
    """Fit the paper's delay; its error is that of a uniform distribution within a sample."""
    start = time.process_time()
    c = correlation(rows)
    std = c.mean_step / math.sqrt(12.0)
    rest = c.response[c.lag:] - c.command[:len(c.command) - c.lag]
    notes = (
        f"lag of {c.lag} row(s) x mean step {c.mean_step:.4f} s; rows below 0.8 m/s are cut out, "
        f"so the mean step is no sample step: with the median {c.median_step:.4f} s the same lag "
        f"is {c.lag * c.median_step:.3f} s",
        f"parabola through the peak: {c.peak:.3f} rows = {c.peak * c.median_step:.3f} s",
        "a slow sine cannot separate delay and lag: identify without --as-paper for both")
    parameters = {"steering_s": FittedParameter(c.delay, std, "s", std < MAX_TIME_STD)}
    edge = ("steering_s",) if c.lag == COMPARED_LAGS - 1 else ()
    return SubmodelFit("delay", parameters, np.array([[std**2]]), len(rest),
                       float(np.sqrt(np.mean(rest**2))), "rad", True, edge,
                       time.process_time() - start, notes), c
