"""The last fit, made linear: what each named effect did to the residuals, and in which driving.

    d_a = r(with a) - r(without a)          secant of effect a, all else as fitted
    r(l) = r + l d_a                        l = -1: without it, l = 0: as fitted
    t_a = sum_q (k_q - null_q) dr/dk_q      tangent there: how r changes with the size
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.effects import remove_effects

from ..evidence.residuals import Evidence
from ..evidence.rows import RowLabels, repeat_labels
from ..policy import BLOCK_S, MANY_RECORDINGS, TAIL, GradePolicy, Policy
from ..search.fit import Point
from ..search.selection import label_point_rows
from ..unexplained.bases import basis_functions
from ..unexplained.features import message_features, window_features
from .family import variants

STATE = ("speed", "steering_angle", "throttle", "lateral_acceleration", "acceleration",
         "steering_rate")
"""What the force of a cause may depend on; each once as it is and once without its sign."""
PLACE = ("time", "x", "y", "heading")
"""What else the size of a constant cause must not depend on."""


@dataclass(frozen=True, slots=True)
class Secants:
    """A fitted point with secants, tangents (N,) and, of its forces, variants (N, d).

    coordinates: those of the point that are an effect's own.

    unit (N,): what is drawn together for a grade; state: standardised functions (N,) of what the
    car was doing, by name.
    """

    point: Point
    of: Mapping[str, FloatArray]
    tangent: Mapping[str, FloatArray]
    variants: Mapping[str, FloatArray]
    coordinates: Mapping[str, Sequence[int]]
    rows: RowLabels
    unit: IntArray
    features: Mapping[str, FloatArray]


def secants(evidence: Evidence, point: Point, effects: Sequence[str], policy: Policy) -> Secants:
    """Of the effects of a fitted point, given with the largest gain first."""
    p, timing = point.vehicle, point.timing
    found, tangent = {}, {}
    own = {name: starting(point, (f"{name}.",)) for name in effects}
    for name in effects:
        tangent[name] = towards_null(point, own[name])
        before = point.noise.stack(evidence.residuals(remove_effects(p, [name]), timing))[0]
        found[name] = point.residual - before
    rows = label_point_rows(evidence, point, policy)
    # of the last one nobody asks: nothing that is named gained less
    written = {name: variants(evidence, point, name, policy.grade) for name in effects[:-1]}
    return Secants(point, found, tangent, written, own, rows,
                   units(evidence, rows, point, policy.grade), features(evidence, point))


def starting(point: Point, beginnings: tuple[str, ...]) -> list[int]:
    """Coordinates whose names begin so."""
    return [i for i, n in enumerate(point.space.names) if n.startswith(beginnings)]


def towards_null(point: Point, mine: Sequence[int]) -> FloatArray:
    """Change (N,) of the residuals by some coordinates from where the base is, at 0."""
    return np.asarray(point.jacobian[:, mine] @ point.x[mine])


def units(evidence: Evidence, rows: RowLabels, point: Point, policy: GradePolicy) -> IntArray:
    """(N,) recordings, where there are enough; else stretches of time of each."""
    if int(rows.recording.max()) + 1 >= MANY_RECORDINGS:
        return rows.recording
    seconds = len(np.unique(rows.block[rows.channel >= 0])) * BLOCK_S
    length = max(BLOCK_S, seconds / policy.units)
    columns = len(point.noise.motion)
    label = repeat_labels(*evidence.blocks(length), columns)
    still = repeat_labels(np.zeros(len(evidence.motion_drive), dtype=np.int64),
                   evidence.sensor_at_rest.astype(np.int64), columns) > 0
    out = np.unique(np.where(still, label[~still].min() if (~still).any() else 0, label),
                    return_inverse=True)[1].ravel()
    # a standing car is one place in time only: its messages are shared out among all
    out[still] = np.arange(int(still.sum())) % (int(out.max()) + 1)
    return np.asarray(out, dtype=np.int64)


def features(evidence: Evidence, point: Point) -> dict[str, FloatArray]:
    """What the car was doing, (N,) by name, for each of the stacked residuals."""
    windows = window_features(evidence, point.vehicle)
    messages = message_features(evidence, point.vehicle)
    # what mocap and sensors smooth differs where a turn begins
    messages["steering_rate"] = np.zeros_like(messages["steering_rate"])
    columns, sensors = len(point.noise.motion), len(point.noise.sensors)
    return {name: np.concatenate([np.repeat(np.nan_to_num(windows[name]), columns),
                                  np.repeat(np.nan_to_num(messages[name]), sensors)])
            for name in (*STATE, *PLACE)}


def modulations(of: Secants, tail: float) -> FloatArray:
    """(N, k) by what a cause may be written differently: functions of the state, of unit size."""
    columns = []
    for name in STATE:
        for value in (of.features[name], np.abs(of.features[name])):
            low, high = np.quantile(value, [tail, 1.0 - tail])
            columns.append(np.clip(value, low, high))
    out = np.stack(columns, axis=1)
    return np.asarray((out - out.mean(axis=0)) / np.maximum(out.std(axis=0), 1e-9))


def shapes(of: Secants, policy: GradePolicy) -> tuple[list[str], FloatArray]:
    """(variable of each, (N, k)) functions along which the size of a cause may change."""
    names, columns = list[str](), []
    for name in (*STATE, *PLACE):
        waves = policy.waves
        if name == "time":
            span = float(np.ptp(of.features["time"]))
            waves = int(np.clip(2.0 * span / policy.period_s, policy.waves, policy.time_waves))
        found = basis_functions(of.features, (name,), TAIL, waves)
        names += [name] * found.shape[1]
        columns.append(found / np.maximum(found.std(axis=0), 1e-9))
    return names, np.concatenate(columns, axis=1)
