"""Linearise the last fit: the change of the residuals by each effect, and the driving state.

    d_a = r(with a) - r(without a)          secant of effect a, all else as fitted
    r(l) = r + l d_a                        l = -1: without it, l = 0: as fitted
    t_a = sum_q (k_q - null_q) dr/dk_q      tangent at the fit: change of r with the size
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.effects import remove_effects
from dart_lab.identification.evidence.policy import BLOCK_S, MANY_RECORDINGS
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.rows import RowLabels, repeat_labels
from dart_lab.identification.objective import Point, StatedParameters

from ..policy import TAIL
from ..search.selection import label_point_rows
from ..unexplained.bases import basis_functions
from ..unexplained.features import message_features, window_features
from .family import force_variants

# Variables on which the force of a cause may depend, each with and without its sign.
STATE = ("speed", "steering_angle", "throttle", "lateral_acceleration", "acceleration",
         "steering_rate")
# Further variables on which the size of a constant cause must not depend.
PLACE = ("time", "x", "y", "heading")
MIN_UNITS = 16  # stretches of time, where recordings are fewer
SIZE_WAVES = 3  # half waves along each variable on which a size may depend
MIN_PERIOD_S = 5.0  # s; the shortest wave along time ...
MAX_TIME_WAVES = 48  # ... in at most two minutes


@dataclass(frozen=True, slots=True)
class Secants:
    """A fitted point with the secant and tangent (N,) of each effect.

    variants (N, d): changes by other ways to write its force. coordinates: indices of its
    parameters in the point. unit (N,): rows that are drawn together for a grade. features: driving
    state (N,) by name. stated: parameters of the model that were not fitted.
    """

    point: Point
    secant: Mapping[str, FloatArray]
    tangent: Mapping[str, FloatArray]
    variants: Mapping[str, FloatArray]
    coordinates: Mapping[str, Sequence[int]]
    rows: RowLabels
    unit: IntArray
    features: Mapping[str, FloatArray]
    stated: StatedParameters


def secants(evidence: Evidence, point: Point, effects: Sequence[str],
            stated: StatedParameters | None = None) -> Secants:
    """Linearise a fit in its effects, given with the largest gain first."""
    p = point.vehicle
    timing = point.timing
    secant = {}
    tangent = {}
    own = {name: find_coordinates(point, (f"{name}.",)) for name in effects}
    for name in effects:
        tangent[name] = parameter_tangent(point, own[name])
        without = point.noise.stack(evidence.residuals(remove_effects(p, [name]), timing))[0]
        secant[name] = point.residual - without
    rows = label_point_rows(evidence, point)
    # the last effect needs no variants, see ``bag``
    variants = {name: force_variants(evidence, point, name) for name in effects[:-1]}
    return Secants(point, secant, tangent, variants, own, rows,
                   bootstrap_units(evidence, rows, point), features(evidence, point),
                   stated or StatedParameters(np.zeros((len(point.residual), 0)),
                                              np.zeros((0, 0))))


def find_coordinates(point: Point, beginnings: tuple[str, ...]) -> list[int]:
    """Return the indices of coordinates whose names begin with any of ``beginnings``."""
    return [i for i, n in enumerate(point.space.names) if n.startswith(beginnings)]


def parameter_tangent(point: Point, mine: Sequence[int]) -> FloatArray:
    """Return the change (N,) of the residuals by some coordinates, from 0 to their values."""
    return np.asarray(point.jacobian[:, mine] @ point.x[mine])


def bootstrap_units(evidence: Evidence, rows: RowLabels, point: Point) -> IntArray:
    """Return the units (N,) of a bootstrap: recordings, or stretches of time if these are few.

    A stretch is no shorter than BLOCK_S.
    """
    if int(rows.recording.max()) + 1 >= MANY_RECORDINGS:
        return rows.recording
    seconds = len(np.unique(rows.block[rows.channel >= 0])) * BLOCK_S
    length = max(BLOCK_S, seconds / MIN_UNITS)
    columns = len(point.noise.motion)
    label = repeat_labels(*evidence.blocks(length), columns)
    at_rest = repeat_labels(np.zeros(len(evidence.motion_drive), dtype=np.int64),
                            evidence.sensor_at_rest.astype(np.int64), columns) > 0
    first = label[~at_rest].min() if (~at_rest).any() else 0
    out = np.unique(np.where(at_rest, first, label), return_inverse=True)[1].ravel()
    # The car is at rest at one time of a drive only, so these messages are distributed over all.
    out[at_rest] = np.arange(int(at_rest.sum())) % (int(out.max()) + 1)
    return np.asarray(out, dtype=np.int64)


def features(evidence: Evidence, point: Point) -> dict[str, FloatArray]:
    """Return the driving state (N,) of each of the stacked residuals, by name."""
    windows = window_features(evidence, point.vehicle)
    messages = message_features(evidence, point.vehicle)
    # mocap and sensors smooth the begin of a turn differently
    messages["steering_rate"] = np.zeros_like(messages["steering_rate"])
    columns = len(point.noise.motion)
    sensors = len(point.noise.sensors)
    return {name: np.concatenate([np.repeat(np.nan_to_num(windows[name]), columns),
                                  np.repeat(np.nan_to_num(messages[name]), sensors)])
            for name in (*STATE, *PLACE)}


def state_modulations(linear: Secants, tail: float) -> FloatArray:
    """Return functions (N, k) of the state, of unit size, by which a force may differ."""
    columns = []
    for name in STATE:
        for value in (linear.features[name], np.abs(linear.features[name])):
            low, high = np.quantile(value, [tail, 1.0 - tail])
            columns.append(np.clip(value, low, high))
    out = np.stack(columns, axis=1)
    return np.asarray((out - out.mean(axis=0)) / np.maximum(out.std(axis=0), 1e-9))


def size_functions(linear: Secants) -> tuple[list[str], FloatArray]:
    """Return functions (N, k) along which a size may change, and the variable of each."""
    names = list[str]()
    columns = []
    for name in (*STATE, *PLACE):
        waves = SIZE_WAVES
        if name == "time":
            span = float(np.ptp(linear.features["time"]))
            waves = int(np.clip(2.0 * span / MIN_PERIOD_S, SIZE_WAVES, MAX_TIME_WAVES))
        found = basis_functions(linear.features, (name,), TAIL, waves)
        names += [name] * found.shape[1]
        columns.append(found / np.maximum(found.std(axis=0), 1e-9))
    return names, np.concatenate(columns, axis=1)
