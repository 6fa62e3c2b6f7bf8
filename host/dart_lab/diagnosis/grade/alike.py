"""Whether all recordings show one car on one floor: how much each wants of what differs there.

For effect q of PROBES with slope g_q = dr/dk_q at the last fit, and recording u:

    k_uq = -(A_u^-1 s_u)_q,   A_u = sum_(i in u) w_i g_i g_i^T + 1 / width^2,   s_u = sum w g r

with the sandwich of the blocks of u for its covariance. Two groups of recordings are two cars or
floors where the best cut of the k_u into small and large ones lies many standard errors and many
detection sizes apart, and what differs within the groups is little beside it. Equal cars on one
floor differ by what the model lacks, in every drive a little otherwise: that is within.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import apply, catalogue
from dart_lab.report.numbers import some

from ..evidence.residuals import Evidence
from ..evidence.rows import RowLabels, label_rows
from ..policy import AlikePolicy, Policy
from ..search.fit import Point

PROBES: Mapping[str, str] = {
    "grip": "grip", "motor_gain": "drive force", "steering_trim": "angle straight on",
    "steering_gain": "steering angle"}
"""Effects that differ from floor to floor or car to car, and what a reader calls them."""
STEP = 0.1  # of a medium size, one-sided


@dataclass(frozen=True, slots=True)
class Wanted:
    """How much of each probe every recording wants beside the last fit, (n, q) both."""

    recordings: tuple[str, ...]
    size: FloatArray
    error: FloatArray


@dataclass(frozen=True, slots=True)
class Apart:
    """Two groups of recordings that differ in one probe. low, high: (size, standard error)."""

    probe: str
    low: tuple[float, float]
    high: tuple[float, float]
    fewer: tuple[str, ...]  # recordings that want the smaller size
    more: tuple[str, ...]
    within: float  # largest distance of a recording from the mean of its group

    def __str__(self) -> str:
        unit = catalogue()[self.probe].parameters[0].unit
        unit = "" if unit == "relative" else f" {unit}"
        low, high = (f"{size:+.3g} +- {error:.1g}{unit}" for size, error in (self.low, self.high))
        return (f"beside the final model, {PROBES[self.probe]} is {low} in "
                f"{some(self.fewer)} and {high} in {some(self.more)}")

    @property
    def ratio(self) -> float:
        """How many standard errors they are apart."""
        return (self.high[0] - self.low[0]) / float(np.hypot(self.low[1], self.high[1]))


def wanted(evidence: Evidence, names: Sequence[str], point: Point, policy: Policy) -> Wanted:
    """Of recordings that the fit has seen, or of others.

    names: of the recordings, in the order of the evidence.
    """
    r, weight, g, rows = _linear(evidence, point, policy)
    width = policy.prior.effect_width * np.array([_size(name) for name in PROBES])
    pull, size, error = np.diag(width**-2.0), [], []
    for u in range(len(names)):
        mine = rows.recording == u
        slope, w = g[mine], weight[mine]
        back = np.linalg.inv((slope * w[:, None]).T @ slope + pull)
        k = -back @ (slope.T @ (w * r[mine]))
        scores = slope * (w * (r[mine] + slope @ k))[:, None]
        block = np.unique(rows.block[mine], return_inverse=True)[1].ravel()
        sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
        size.append(k)
        error.append(np.sqrt(np.diag(back @ (sums.T @ sums + pull) @ back)))
    return Wanted(tuple(names), np.array(size), np.array(error))


def beside(a: Wanted, b: Wanted) -> Wanted:
    """The recordings of both, those of a first."""
    return Wanted((*a.recordings, *b.recordings), np.concatenate([a.size, b.size]),
                  np.concatenate([a.error, b.error]))


def apart(of: Wanted, policy: AlikePolicy) -> Apart | None:
    """The clearest two groups, or None where the recordings are alike."""
    found = [cut for i, probe in enumerate(PROBES) for cut in _cuts(of, i, probe)
             if cut.ratio > policy.errors and cut.high[0] - cut.low[0] > policy.least * _size(probe)
             and cut.high[0] - cut.low[0] > policy.within * cut.within]
    return max(found, key=lambda cut: cut.ratio, default=None)


def _linear(evidence: Evidence, point: Point, policy: Policy
            ) -> tuple[FloatArray, FloatArray, FloatArray, RowLabels]:
    """Residuals (N,), weights (N,), slopes (N, q) of the probes, labels."""
    p, timing = point.vehicle, point.timing
    noise = replace(point.noise, age_scale=1.0)  # it knows the windows of the training recordings
    residuals = evidence.residuals(p, timing)
    r, weight = noise.stack(residuals)
    slopes = []
    for name in PROBES:
        step = STEP * _size(name)
        now = next((a.values[0] for a in p.effects if a.name == name),
                   catalogue()[name].parameters[0].null)
        moved = evidence.residuals(apply(p, name, k=now + step), timing)
        slopes.append((noise.stack(moved)[0] - r) / step)
    return (r, weight * noise.robust_weight(r), np.stack(slopes, axis=1),
            label_rows(evidence, residuals, policy.blocks))


def _size(name: str) -> float:
    """A medium size of an effect, in its unit."""
    return catalogue()[name].parameters[0].sizes[1]


def _cuts(of: Wanted, i: int, probe: str) -> Iterator[Apart]:
    """Every cut of the recordings into those that want less and those that want more."""
    order = np.argsort(of.size[:, i])
    for n in range(1, len(order)):
        few, many = order[:n], order[n:]
        low, high = (_mean(of.size[part, i], of.error[part, i]) for part in (few, many))
        within = np.concatenate([of.size[few, i] - low[0], of.size[many, i] - high[0]])
        yield Apart(probe, low, high, tuple(of.recordings[k] for k in sorted(few)),
                    tuple(of.recordings[k] for k in sorted(many)),
                    float(np.abs(within).max(initial=0.0)))


def _mean(size: FloatArray, error: FloatArray) -> tuple[float, float]:
    """Weighted, with its standard error; what differs more than errors say counts in it."""
    weight = error**-2.0
    mean = float(weight @ size / weight.sum())
    excess = float(weight @ (size - mean)**2) / max(len(size) - 1, 1)
    return mean, float(np.sqrt(max(excess, 1.0) / weight.sum()))
