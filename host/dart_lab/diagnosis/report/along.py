"""Where a residual shows: its mean along what the car did, before and after a cause is in.

All on the test recordings. Rows next to each other share their disturbance,
so the standard error of a mean comes from stretches of 2 s, not from rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.diagnosis.evidence.drive import READ_OUTS
from dart_lab.diagnosis.evidence.onboard import ONBOARD_MOTION as ONBOARD
from dart_lab.diagnosis.evidence.onboard import OnboardEvidence
from dart_lab.diagnosis.evidence.onboard_drive import ENCODER_MEAN_S, MESSAGES_AHEAD
from dart_lab.diagnosis.evidence.readings import SENSORS
from dart_lab.diagnosis.evidence.residuals import MOTION, Evidence, Residuals
from dart_lab.diagnosis.result import Stage
from dart_lab.diagnosis.unexplained.features import (
    FEATURE_UNITS,
    Features,
    message_features,
    window_features,
)
from dart_lab.identification.evaluation.cases import short

from .words import CHANNELS

BINS, FEWEST, THIN = 10, 40, 0.02
"""Parts of a variable, rows below which there is nothing to draw, least share of them in a part."""
EDGE = 0.01  # quantile at which the first and the last part end
STRETCH = 2.0  # s
WHISKER = 2.0  # standard errors that one reaches to each side
STRETCHES = 3  # below that many a mean has no standard error
SHOWN = (1.0, 0.25)
"""s after the start of a window, or a little more, at which predictions are looked at."""
AHEAD_OF_PATTERNS = 0.5  # s, where patterns without a cause are searched
SIDEWAYS = ("v_y", "omega", "gyro", "accel_y")
"""Channels that change sign with the turn: their errors also show in the sense of the turn."""
SIGNED = ("steering_angle", "lateral_acceleration", "yaw_rate")
"""Variables along which the sense of the turn is the axis itself."""
MEANT = {"vx": ("v_x",), "position": ("v_x",), "vy": ("v_y",), "yaw_rate": ("omega",),
         "yaw_deg": ("omega",)}
"""Residuals in which a gain of an open-loop channel is looked for."""
GAP = 0.15
"""Share of the range of a variable; a longer part without any row interrupts the line. Where
driving is even, a part is a tenth of the range (BINS): half as much again is missing."""


@dataclass(frozen=True, slots=True)
class Column:
    """One residual: column ``index`` of the motion ``after`` [s] a start, or (0) of the sensors."""

    channel: str
    index: int
    after: float = 0.0
    folded: bool = False

    @property
    def words(self) -> str:
        """Which error it is."""
        after = f" after {self.after:g} s" if self.after else ""
        sense = ", in the sense of the turn" if self.folded else ""
        return f"{CHANNELS[self.channel][0]} error{after}{sense}"

    @property
    def unit(self) -> str:
        return CHANNELS[self.channel][1]

    def of(self, r: Residuals, noise_scale: FloatArray) -> FloatArray:
        """Its residuals (rows,) in SI units, not folded; noise_scale: as of ``Evidence``."""
        of = r.motion if self.after else r.sensors / noise_scale
        return np.asarray(of[:, self.index])


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
        self._evidence, self._p = evidence, p
        self._motion, self._sensor = evidence.blocks(STRETCH)
        self._noise_scale = evidence.noise_scale
        self._features: dict[float, Features] = {}

    def features(self, column: Column) -> Features:
        """(rows,) each, of the time over which this residual came about."""
        if column.after not in self._features:
            self._features[column.after] = (
                window_features(self._evidence, self._p, round(column.after / SAMPLE))
                if column.after else message_features(self._evidence, self._p))
        return self._features[column.after]

    def stretch(self, column: Column) -> IntArray:
        """Label (rows,) of the stretch of 2 s."""
        return self._motion if column.after else self._sensor

    def values(self, column: Column, r: Residuals) -> FloatArray:
        """Residuals (rows,), folded where the column says so; NaN where there is none."""
        values = column.of(r, self._noise_scale)
        return values * self.features(column)["direction"] if column.folded else values

    def means(self, column: Column, variable: str, r: Residuals, period: float = 0.0
              ) -> Means | None:
        """Along a variable; None with too few rows, or where the variable does not vary.

        period: after which it counts from 0 again.
        """
        x, y = self.features(column)[variable], self.values(column, r)
        x = x % period if period else x
        good = np.isfinite(x) & np.isfinite(y)
        if column.folded:
            good &= self.features(column)["direction"] != 0.0
        if good.sum() < FEWEST:
            return None
        return means_along(x[good], y[good], self.stretch(column)[good])

    def by_recording(self, column: Column, r: Residuals) -> tuple[tuple[str, ...], Means]:
        """Names of the recordings, and the mean residual of each at x = 0, 1, 2..."""
        values = self.values(column, r)
        evidence = self._evidence
        drive = evidence.motion_drive if column.after else evidence.sensor_drive
        shown = [i for i in range(len(evidence.drives))
                 if np.isfinite(values[drive == i]).sum() >= STRETCHES]
        good = [(drive == i) & np.isfinite(values) for i in shown]
        m = _means([(drive[g], values[g], self.stretch(column)[g]) for g in good])
        names = tuple(short(evidence.drives[i].recording.name) for i in shown)
        return names, replace(m, x=np.arange(float(len(shown))))


def columns(evidence: Evidence, channel: str = "", seconds: Sequence[float] = SHOWN
            ) -> list[Column]:
    """Residuals that a gain in ``channel`` may show in; "" = all that these data have.

    seconds: after the start of a window, at which predictions are taken.
    """
    wanted = MEANT.get(channel, (channel,)) if channel else tuple(CHANNELS)
    predicted, times = _predicted(evidence)
    reads = dict.fromkeys(int(np.searchsorted(times, t - 1e-9)) for t in seconds)
    out = [Column(c, read * len(predicted) + j, times[read])
           for j, c in enumerate(predicted) if c in wanted for read in reads]
    if len(evidence.sensor_drive):
        out += [Column(c, j) for j, c in enumerate(SENSORS) if c in wanted]
    return out + [replace(c, folded=True) for c in out if c.channel in SIDEWAYS]


def _predicted(evidence: Evidence) -> tuple[tuple[str, ...], list[float]]:
    """Channels of a prediction, and its read-outs [s] from the start: with mocap, and without."""
    if isinstance(evidence, OnboardEvidence):
        return ONBOARD, [round((i + 1) * ENCODER_MEAN_S, 6) for i in range(MESSAGES_AHEAD)]
    return MOTION, [r * SAMPLE for r in READ_OUTS]


def most(rows: Rows, wanted: Sequence[Column], before: Stage, after: Stage,
         variables: Sequence[str]) -> Along | None:
    """Column and variable along which most of the structure goes away; None where none does."""
    tried = [along(rows, column, name, before, after) for column in wanted for name in variables
             if not (column.folded and name in SIGNED)]
    found = [a for a in tried if a is not None and a.score > 0.0]
    return max(found, key=lambda a: a.score, default=None)


def along(rows: Rows, column: Column, variable: str, before: Stage, after: Stage | None = None,
          period: float = 0.0) -> Along | None:
    """One picture; None where there is too little to draw."""
    if variable not in FEATURE_UNITS:
        return None
    was = rows.means(column, variable, before.residuals, period)
    now = rows.means(column, variable, after.residuals, period) if after is not None else was
    if was is None or now is None:
        return None
    values = rows.values(column, before.residuals)
    size = float(np.nanmean(np.square(values)))
    score = _structure(was) - (_structure(now) if after is not None else 0.0)
    if not math.isfinite(score) or size <= 0.0:
        return None
    return Along(column, variable, was, now, score / size)


def _structure(m: Means) -> float:
    """Mean square of the means beyond what their standard errors would give."""
    known = np.isfinite(m.mean) & np.isfinite(m.error)
    beyond = np.square(m.mean[known]) - np.square(m.error[known])
    return float(m.n[known] @ beyond / m.n.sum())


def means_along(x: FloatArray, y: FloatArray, stretch: IntArray) -> Means | None:
    """Of y (rows,) along x (rows,); None where x does not vary, or too little of it is driven."""
    low, high = np.quantile(x, [EDGE, 1.0 - EDGE])
    if high - low < 1e-6:
        return None
    # halfway between equal numbers and equal widths: a steering angle is mostly at rest
    share = np.linspace(0.0, 1.0, BINS + 1)[1:-1]
    edges = 0.5 * (np.quantile(x, share) + low + share * (high - low))
    which = np.searchsorted(edges, x)
    parts = [which == i for i in range(BINS)]
    enough = [p for p in parts if p.sum() >= THIN * len(x)]
    if len(enough) <= 2:
        return None
    means = _means([(x[p], y[p], stretch[p]) for p in enough])
    ordered = np.sort(x)
    ends = np.searchsorted(ordered, means.x)
    longest = [np.diff(ordered[max(a - 1, 0):b + 1]).max(initial=0.0)
               for a, b in pairwise(ends.tolist())]
    return _with_gaps(means, 1 + np.flatnonzero(np.array(longest) > GAP * (high - low)))


def _with_gaps(m: Means, places: IntArray) -> Means:
    """Insert a point that is not a number before each of the places, where a line ends."""
    x, mean, error = (np.insert(v, places, math.nan) for v in (m.x, m.mean, m.error))
    return Means(x, mean, error, np.insert(m.n, places, 0.0))


def _means(parts: Sequence[tuple[FloatArray, FloatArray, IntArray]]) -> Means:
    x = [float(np.mean(p[0])) if len(p[0]) else math.nan for p in parts]
    mean = [float(np.mean(p[1])) if len(p[1]) else math.nan for p in parts]
    return Means(np.array(x), np.array(mean), np.array([_error(y, s) for _, y, s in parts]),
                 np.array([float(len(y)) for _, y, _ in parts]))


def _error(y: FloatArray, stretch: IntArray) -> float:
    """Standard error of the mean of y (n,) with rows of one stretch moving together."""
    _, index = np.unique(stretch, return_inverse=True)
    blocks = int(index.max()) + 1 if len(index) else 0
    if blocks < STRETCHES:
        return math.nan
    sums = np.bincount(index, y - y.mean())
    return float(np.sqrt(sums @ sums * blocks / (blocks - 1)) / len(y))
