"""Where a residual shows: its mean along what the car did, before and after a cause is in.

All on the test recordings. Rows next to each other share their disturbance,
so the standard error of a mean comes from stretches of 2 s, not from rows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dart_hal.diagnose.drive import READ, STEP
from dart_hal.diagnose.features import UNITS, Features, message_features, window_features
from dart_hal.diagnose.residuals import MOTION, SENSORS, Evidence, Residuals
from dart_hal.diagnose.result import Diagnosis, Stage
from dart_hal.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from .words import CHANNELS

BINS, FEWEST, THIN = 10, 40, 0.02
"""Parts of a variable, rows below which there is nothing to draw, least share of them in a part."""
EDGE = 0.01  # quantile at which the first and the last part end
STRETCH = 2.0  # s
STRETCHES = 3  # below that many a mean has no standard error
EARLY, LATE = READ.index(25), READ.index(100)
SIDEWAYS = ("v_y", "omega", "gyro", "accel_y")
"""Channels that change sign with the turn: their errors also show in the sense of the turn."""
MEANT = {"vx": ("v_x",), "position": ("v_x",), "vy": ("v_y",), "yaw_rate": ("omega",),
         "yaw_deg": ("omega",)}
"""Residuals in which a gain of an open-loop channel is looked for."""
SIDES = ("left", "straight on", "right")
AS_GOOD = 0.9
"""Share of the best score from where on an earlier variable of UNITS is taken: speed tells more
to a reader than the heading does."""


@dataclass(frozen=True, slots=True)
class Column:
    """One residual: motion after READ[read] samples (read >= 0), or a sensor (read = -1)."""

    channel: str
    read: int = -1
    folded: bool = False

    @property
    def words(self) -> str:
        """Which error it is."""
        after = f" after {READ[self.read] * STEP:g} s" if self.read >= 0 else ""
        sense = ", in the sense of the turn" if self.folded else ""
        return f"{CHANNELS[self.channel][0]} error{after}{sense}"

    @property
    def unit(self) -> str:
        return CHANNELS[self.channel][1]

    def of(self, r: Residuals) -> FloatArray:
        """Its residuals (rows,), not folded."""
        if self.read < 0:
            return np.asarray(r.sensors[:, SENSORS.index(self.channel)])
        return np.asarray(r.motion[:, self.read * len(MOTION) + MOTION.index(self.channel)])


@dataclass(frozen=True, slots=True)
class Means:
    """Mean residual over each part of a variable (k,), and its standard error (NaN: unknown).

    n (k,): rows of each part.
    """

    x: FloatArray
    mean: FloatArray
    error: FloatArray
    n: FloatArray


@dataclass(frozen=True, slots=True)
class Along:
    """One residual along one variable before and after; score: mean square that went away."""

    column: Column
    variable: str
    before: Means
    after: Means
    score: float


class Rows:
    """Features and stretches of every row of the residuals of a diagnosis."""

    def __init__(self, evidence: Evidence, p: Vehicle) -> None:
        self._motion, self._sensor = evidence.blocks(STRETCH)
        self._windows = {read: window_features(evidence, p, READ[read]) for read in (EARLY, LATE)}
        self._messages = message_features(evidence, p)

    def features(self, column: Column) -> Features:
        """(rows,) each, of the time over which this residual came about."""
        return self._messages if column.read < 0 else self._windows[column.read]

    def stretch(self, column: Column) -> NDArray[np.int64]:
        """Label (rows,) of the stretch of 2 s."""
        return self._sensor if column.read < 0 else self._motion

    def values(self, column: Column, r: Residuals) -> FloatArray:
        """Residuals (rows,), folded where the column says so; NaN where there is none."""
        values = column.of(r)
        return values * self.features(column)["direction"] if column.folded else values

    def means(self, column: Column, variable: str, r: Residuals) -> Means | None:
        """Along a variable; None with too few rows, or where the variable does not vary."""
        x, y = self.features(column)[variable], self.values(column, r)
        good = np.isfinite(x) & np.isfinite(y)
        if column.folded:
            good &= self.features(column)["direction"] != 0.0
        if good.sum() < FEWEST:
            return None
        x, y, stretch = x[good], y[good], self.stretch(column)[good]
        low, high = np.quantile(x, [EDGE, 1.0 - EDGE])
        if high - low < 1e-6:
            return None
        # halfway between equal numbers and equal widths: a steering angle is mostly at rest
        share = np.linspace(0.0, 1.0, BINS + 1)[1:-1]
        edges = 0.5 * (np.quantile(x, share) + low + share * (high - low))
        which = np.searchsorted(edges, x)
        parts = [which == i for i in range(BINS)]
        enough = [p for p in parts if p.sum() >= THIN * len(x)]
        return _means([(x[p], y[p], stretch[p]) for p in enough]) if len(enough) > 2 else None

    def sides(self, column: Column, r: Residuals) -> Means | None:
        """Left, straight on, right, at x = 0, 1, 2; NaN where the car did not drive so."""
        y, direction = column.of(r), self.features(column)["direction"]
        good = np.isfinite(y)
        if good.sum() < FEWEST:
            return None
        parts = [good & (direction == side) for side in (1.0, 0.0, -1.0)]
        m = _means([(direction[p], y[p], self.stretch(column)[p]) for p in parts])
        return Means(np.arange(3.0), m.mean, m.error, m.n)


def columns(evidence: Evidence, channel: str = "") -> list[Column]:
    """Residuals that a gain in ``channel`` may show in; "" = all that these data have."""
    wanted = MEANT.get(channel, (channel,)) if channel else (*MOTION, *SENSORS)
    out = [Column(c, read) for c in MOTION if c in wanted for read in (LATE, EARLY)]
    if len(evidence.sensor_drive):
        out += [Column(c) for c in SENSORS if c in wanted]
    return out + [Column(c.channel, c.read, True) for c in out if c.channel in SIDEWAYS]


def most(rows: Rows, wanted: Sequence[Column], before: Stage, after: Stage | None = None
         ) -> Along | None:
    """Column and variable along which most of the structure goes away; without after: is."""
    found = [a for c in wanted for a in _tried(rows, c, before, after)]
    best = max((a.score for a in found), default=0.0)
    if best <= 0.0:
        return None
    order = list(UNITS)
    return min((a for a in found if a.score >= AS_GOOD * best),
               key=lambda a: order.index(a.variable))


def along(rows: Rows, column: Column, variable: str, before: Stage, after: Stage | None = None
          ) -> Along | None:
    """One picture; None where there is too little to draw."""
    was = rows.means(column, variable, before.residuals)
    now = rows.means(column, variable, after.residuals) if after is not None else was
    if was is None or now is None:
        return None
    values = rows.values(column, before.residuals)
    size = float(np.nanmean(np.square(values)))
    score = _structure(was) - (_structure(now) if after is not None else 0.0)
    if not math.isfinite(score) or size <= 0.0:
        return None
    return Along(column, variable, was, now, score / size)


def stages_of(d: Diagnosis, i: int) -> tuple[Stage, Stage]:
    """The stage before and the one with the cause number i."""
    at = len(d.stages) - len(d.causes) + i
    return d.stages[at - 1], d.stages[at]


def _tried(rows: Rows, column: Column, before: Stage, after: Stage | None) -> Iterator[Along]:
    for variable in UNITS:
        if variable == "direction" or (column.folded and variable in (
                "steering_angle", "lateral_acceleration", "yaw_rate")):
            continue  # there the sense of the turn is the axis itself
        found = along(rows, column, variable, before, after)
        if found is not None:
            yield found


def _structure(m: Means) -> float:
    """Mean square of the means beyond what their standard errors would give."""
    known = np.isfinite(m.mean) & np.isfinite(m.error)
    beyond = np.square(m.mean[known]) - np.square(m.error[known])
    return float(m.n[known] @ beyond / m.n.sum())


def _means(parts: Sequence[tuple[FloatArray, FloatArray, NDArray[np.int64]]]) -> Means:
    x = [float(np.mean(p[0])) if len(p[0]) else math.nan for p in parts]
    mean = [float(np.mean(p[1])) if len(p[1]) else math.nan for p in parts]
    return Means(np.array(x), np.array(mean), np.array([_error(y, s) for _, y, s in parts]),
                 np.array([float(len(y)) for _, y, _ in parts]))


def _error(y: FloatArray, stretch: NDArray[np.int64]) -> float:
    """Standard error of the mean of y (n,) with rows of one stretch moving together."""
    _, index = np.unique(stretch, return_inverse=True)
    blocks = int(index.max()) + 1 if len(index) else 0
    if blocks < STRETCHES:
        return math.nan
    sums = np.bincount(index, y - y.mean())
    return float(np.sqrt(sums @ sums * blocks / (blocks - 1)) / len(y))
