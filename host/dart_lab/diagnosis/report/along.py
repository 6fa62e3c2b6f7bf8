"""Mean residual along a variable of the drive, before and after a cause is in the model.

All on the test recordings. Neighbouring rows share their disturbance, so the standard error of a
mean is computed from blocks of 2 s instead of rows.
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
from dart_lab.diagnosis.result import Stage
from dart_lab.diagnosis.unexplained.features import (
    FEATURE_UNITS,
    Features,
    message_features,
    window_features,
)
from dart_lab.identification.evaluation.cases import short
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.onboard import ONBOARD_MOTION as ONBOARD
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.onboard_drive import ENCODER_MEAN_S, MESSAGES_AHEAD
from dart_lab.identification.evidence.readings import SENSORS
from dart_lab.identification.evidence.residuals import MOTION, Evidence, Residuals

from .words import CHANNEL_LABELS

PARTS = 10  # of the range of a variable
MIN_PICTURE_ROWS = 40  # of a picture
MIN_PART_SHARE = 0.02  # of the rows, in a part that is drawn
EDGE_QUANTILE = 0.01  # ends of the range of a variable
BLOCK_S = 2.0  # s
WHISKER_ERRORS = 2.0  # standard errors, length of a whisker on each side
MIN_BLOCKS = 3  # for the standard error of a mean
# s after the start of a window: the first later time of each is drawn.
PREDICTION_TIMES = (1.0, 0.25)
PATTERN_TIME = 0.5  # s after the start of a window, as in the search for structure
# Channels that change sign with the turn: their errors are also drawn in the sense of the turn.
LATERAL_CHANNELS = ("v_y", "omega", "gyro", "accel_y")
# Variables whose sign is the sense of the turn.
SIGNED_VARIABLES = ("steering_angle", "lateral_acceleration", "yaw_rate")
# Residuals in which a gain of an open-loop channel is searched.
RESIDUAL_CHANNELS = {"vx": ("v_x",), "position": ("v_x",), "vy": ("v_y",), "yaw_rate": ("omega",),
         "yaw_deg": ("omega",)}
# Share of the range of a variable: a longer part without any row interrupts the line. With even
# driving a part is a tenth of the range (PARTS); this is half as much again.
MAX_GAP_SHARE = 0.15


@dataclass(frozen=True, slots=True)
class ResidualColumn:
    """One residual: column ``index`` of the motion ``after`` [s] a start, or (0) of the sensors."""

    channel: str
    index: int
    after: float = 0.0
    folded: bool = False

    @property
    def words(self) -> str:
        """Describe the error."""
        after = f" after {self.after:g} s" if self.after else ""
        sense = ", in the sense of the turn" if self.folded else ""
        return f"{CHANNEL_LABELS[self.channel][0]} error{after}{sense}"

    @property
    def unit(self) -> str:
        return CHANNEL_LABELS[self.channel][1]

    def select_column(self, r: Residuals, noise_scale: FloatArray) -> FloatArray:
        """Select the residuals (rows,) in SI units, not folded; noise_scale: as of ``Evidence``."""
        table = r.motion if self.after else r.sensors / noise_scale
        return np.asarray(table[:, self.index])


@dataclass(frozen=True, slots=True)
class Means:
    """Mean residual in each part of a variable (k,), and its standard error (NaN: unknown).

    n (k,): rows of each part.
    """

    x: FloatArray
    mean: FloatArray
    error: FloatArray
    n: FloatArray


@dataclass(frozen=True, slots=True)
class ResidualCurve:
    """One residual along one variable before and after; score: reduction of the mean square."""

    column: ResidualColumn
    variable: str
    before: Means
    after: Means
    score: float


class ResidualRows:
    """Features and blocks of every row of the residuals of a diagnosis."""

    def __init__(self, evidence: Evidence, p: Vehicle) -> None:
        self._evidence = evidence
        self._p = p
        self._motion, self._sensor = evidence.blocks(BLOCK_S)
        self._noise_scale = evidence.noise_scale
        self._features: dict[float, Features] = {}

    def features(self, column: ResidualColumn) -> Features:
        """Features (rows,) of the time in which this residual arose."""
        if column.after not in self._features:
            self._features[column.after] = (
                window_features(self._evidence, self._p, round(column.after / SAMPLE))
                if column.after else message_features(self._evidence, self._p))
        return self._features[column.after]

    def block(self, column: ResidualColumn) -> IntArray:
        """Label (rows,) of the block of 2 s."""
        return self._motion if column.after else self._sensor

    def values(self, column: ResidualColumn, r: Residuals) -> FloatArray:
        """Residuals (rows,), folded if the column is; NaN if missing."""
        values = column.select_column(r, self._noise_scale)
        return values * self.features(column)["direction"] if column.folded else values

    def means(self, column: ResidualColumn, variable: str, r: Residuals, period: float = 0.0
              ) -> Means | None:
        """Average along a variable; None with too few rows, or if the variable is constant.

        period: the variable is taken modulo this period, if not 0.
        """
        x = self.features(column)[variable]
        y = self.values(column, r)
        x = x % period if period else x
        good = np.isfinite(x) & np.isfinite(y)
        if column.folded:
            good &= self.features(column)["direction"] != 0.0
        if good.sum() < MIN_PICTURE_ROWS:
            return None
        return means_along(x[good], y[good], self.block(column)[good])

    def by_recording(self, column: ResidualColumn, r: Residuals) -> tuple[tuple[str, ...], Means]:
        """Names of the recordings, and the mean residual of each at x = 0, 1, 2..."""
        values = self.values(column, r)
        evidence = self._evidence
        drive = evidence.motion_drive if column.after else evidence.sensor_drive
        shown = [i for i in range(len(evidence.drives))
                 if np.isfinite(values[drive == i]).sum() >= MIN_BLOCKS]
        good = [(drive == i) & np.isfinite(values) for i in shown]
        m = _means([(drive[g], values[g], self.block(column)[g]) for g in good])
        names = tuple(short(evidence.drives[i].recording.name) for i in shown)
        return names, replace(m, x=np.arange(float(len(shown))))


def list_columns(evidence: Evidence, channel: str = "", seconds: Sequence[float] = PREDICTION_TIMES
            ) -> list[ResidualColumn]:
    """List the residuals in which a gain in ``channel`` may show; "" = all that these data have.

    seconds: after the start of a window, at which predictions are taken.
    """
    channels = RESIDUAL_CHANNELS.get(channel, (channel,)) if channel else tuple(CHANNEL_LABELS)
    predicted, times = _prediction_channels(evidence)
    reads = dict.fromkeys(int(np.searchsorted(times, t - 1e-9)) for t in seconds)
    out = [ResidualColumn(c, read * len(predicted) + j, times[read])
           for j, c in enumerate(predicted) if c in channels for read in reads]
    if len(evidence.sensor_drive):
        out += [ResidualColumn(c, j) for j, c in enumerate(SENSORS) if c in channels]
    return out + [replace(c, folded=True) for c in out if c.channel in LATERAL_CHANNELS]


def _prediction_channels(evidence: Evidence) -> tuple[tuple[str, ...], list[float]]:
    """Channels of a prediction, and its times [s] from the start: with mocap, and without."""
    if isinstance(evidence, OnboardEvidence):
        return ONBOARD, [round((i + 1) * ENCODER_MEAN_S, 6) for i in range(MESSAGES_AHEAD)]
    return MOTION, [r * SAMPLE for r in READ_OUTS]


def find_largest_change(rows: ResidualRows, candidates: Sequence[ResidualColumn],
                        first_stage: Stage, second_stage: Stage,
                        variables: Sequence[str]) -> ResidualCurve | None:
    """Find the column and variable with the largest reduction of structure; None without one."""
    tried = [compute_curve(rows, column, name, first_stage, second_stage) for column in candidates
             for name in variables if not (column.folded and name in SIGNED_VARIABLES)]
    found = [a for a in tried if a is not None and a.score > 0.0]
    return max(found, key=lambda a: a.score, default=None)


def compute_curve(rows: ResidualRows, column: ResidualColumn, variable: str, first_stage: Stage,
                  second_stage: Stage | None = None, period: float = 0.0) -> ResidualCurve | None:
    """Compute the means along a variable in one or two stages; None if there are too few data."""
    if variable not in FEATURE_UNITS:
        return None
    was = rows.means(column, variable, first_stage.residuals, period)
    now = rows.means(column, variable, second_stage.residuals,
                     period) if second_stage is not None else was
    if was is None or now is None:
        return None
    values = rows.values(column, first_stage.residuals)
    size = float(np.nanmean(np.square(values)))
    score = _structure(was) - (_structure(now) if second_stage is not None else 0.0)
    if not math.isfinite(score) or size <= 0.0:
        return None
    return ResidualCurve(column, variable, was, now, score / size)


def _structure(m: Means) -> float:
    """Mean square of the means minus the expectation by their standard errors."""
    known = np.isfinite(m.mean) & np.isfinite(m.error)
    beyond = np.square(m.mean[known]) - np.square(m.error[known])
    return float(m.n[known] @ beyond / m.n.sum())


def means_along(x: FloatArray, y: FloatArray, block: IntArray) -> Means | None:
    """Average y (rows,) along x (rows,); None if x is constant or too little of it is driven."""
    low, high = np.quantile(x, [EDGE_QUANTILE, 1.0 - EDGE_QUANTILE])
    if high - low < 1e-6:
        return None
    # Edges halfway between quantiles and equal widths: a steering angle is mostly near 0.
    share = np.linspace(0.0, 1.0, PARTS + 1)[1:-1]
    edges = 0.5 * (np.quantile(x, share) + low + share * (high - low))
    which = np.searchsorted(edges, x)
    parts = [which == i for i in range(PARTS)]
    enough = [p for p in parts if p.sum() >= MIN_PART_SHARE * len(x)]
    if len(enough) <= 2:
        return None
    means = _means([(x[p], y[p], block[p]) for p in enough])
    # Interrupt the line where the largest distance between neighbouring rows of x is too long.
    ordered = np.sort(x)
    ends = np.searchsorted(ordered, means.x)
    longest = [np.diff(ordered[max(a - 1, 0):b + 1]).max(initial=0.0)
               for a, b in pairwise(ends.tolist())]
    return _with_gaps(means, 1 + np.flatnonzero(np.array(longest) > MAX_GAP_SHARE * (high - low)))


def _with_gaps(m: Means, places: IntArray) -> Means:
    """Insert a NaN point before each of the places, to interrupt a line."""
    x, mean, error = (np.insert(v, places, math.nan) for v in (m.x, m.mean, m.error))
    return Means(x, mean, error, np.insert(m.n, places, 0.0))


def _means(parts: Sequence[tuple[FloatArray, FloatArray, IntArray]]) -> Means:
    """Means of x and y in each part, with the standard error of y."""
    x = [float(np.mean(p[0])) if len(p[0]) else math.nan for p in parts]
    mean = [float(np.mean(p[1])) if len(p[1]) else math.nan for p in parts]
    return Means(np.array(x), np.array(mean), np.array([_error(y, s) for _, y, s in parts]),
                 np.array([float(len(y)) for _, y, _ in parts]))


def _error(y: FloatArray, block: IntArray) -> float:
    """Standard error of the mean of y (n,), with correlated rows within a block."""
    _, index = np.unique(block, return_inverse=True)
    blocks = int(index.max()) + 1 if len(index) else 0
    if blocks < MIN_BLOCKS:
        return math.nan
    # Sandwich estimate with the blocks as independent units.
    sums = np.bincount(index, y - y.mean())
    return float(np.sqrt(sums @ sums * blocks / (blocks - 1)) / len(y))
