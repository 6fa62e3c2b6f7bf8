"""Test whether all recordings are of one car on one floor.

For effect q of PROBES with slope g_q = dr/dk_q at the last fit, and recording u:

    k_uq = -(A_u^-1 s_u)_q,   A_u = sum_(i in u) w_i g_i g_i^T + 1 / width^2,   s_u = sum w g r

with the sandwich of the blocks of u for its covariance. Two groups of recordings are two cars or
floors where the best cut of the k_u into small and large ones is many standard errors and many
detection sizes wide, and differences within the groups are small compared with it. Recordings of
one car on one floor differ too, by the effect of missing causes in different driving: that is the
difference within groups.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import apply, catalogue
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.rows import RowLabels, label_rows
from dart_lab.identification.objective import Point
from dart_lab.report.numbers import shorten_list

from ..policy import Policy, TwoCarsPolicy

# Effects that differ from floor to floor or car to car, and their names for a reader.
PROBES: Mapping[str, str] = {
    "grip": "grip", "motor_gain": "drive force", "steering_trim": "angle straight on",
    "steering_gain": "steering angle"}
PROBE_STEP = 0.1  # of a medium size; one-sided difference for a slope


@dataclass(frozen=True, slots=True)
class SizesByRecording:
    """Size and standard error of each probe in each recording, relative to a fit, (n, q) both."""

    recordings: tuple[str, ...]
    size: FloatArray
    error: FloatArray


@dataclass(frozen=True, slots=True)
class RecordingGroups:
    """Two groups of recordings that differ in one probe.

    low, high: (size, standard error) of the groups; smaller, larger: their recordings; within:
    largest distance of a recording from the mean of its group.
    """

    probe: str
    low: tuple[float, float]
    high: tuple[float, float]
    smaller: tuple[str, ...]
    larger: tuple[str, ...]
    within: float

    def __str__(self) -> str:
        unit = catalogue()[self.probe].parameters[0].unit
        unit = "" if unit == "relative" else f" {unit}"
        low, high = (f"{size:+.3g} +- {error:.1g}{unit}" for size, error in (self.low, self.high))
        return (f"relative to the final model, {PROBES[self.probe]} is {low} in "
                f"{shorten_list(self.smaller)} and {high} in {shorten_list(self.larger)}")

    @property
    def ratio(self) -> float:
        """Difference of the groups in standard errors."""
        return (self.high[0] - self.low[0]) / float(np.hypot(self.low[1], self.high[1]))


def estimate_sizes(evidence: Evidence, names: Sequence[str], point: Point, policy: Policy
                   ) -> SizesByRecording:
    """Estimate the size of each probe in each recording, from training or other recordings.

    names: of the recordings, in the order of the evidence.
    """
    r, weight, g, rows = _linearise(evidence, point)
    width = policy.prior.effect_width * np.array([_medium_size(name) for name in PROBES])
    prior = np.diag(width**-2.0)
    size = []
    error = []
    for u in range(len(names)):
        mine = rows.recording == u
        slope = g[mine]
        w = weight[mine]
        # Least squares with a prior, for the rows of one recording: k = -(G'WG + P)^-1 G'W r.
        inverse = np.linalg.inv((slope * w[:, None]).T @ slope + prior)
        k = -inverse @ (slope.T @ (w * r[mine]))
        # Sandwich: residuals of one block are correlated, so their scores are summed first.
        scores = slope * (w * (r[mine] + slope @ k))[:, None]
        block = np.unique(rows.block[mine], return_inverse=True)[1].ravel()
        sums = np.stack([np.bincount(block, column) for column in scores.T], axis=1)
        size.append(k)
        error.append(np.sqrt(np.diag(inverse @ (sums.T @ sums + prior) @ inverse)))
    return SizesByRecording(tuple(names), np.array(size), np.array(error))


def join_sizes(a: SizesByRecording, b: SizesByRecording) -> SizesByRecording:
    """Join the recordings of both, those of a first."""
    return SizesByRecording((*a.recordings, *b.recordings), np.concatenate([a.size, b.size]),
                            np.concatenate([a.error, b.error]))


def find_groups(sizes: SizesByRecording, policy: TwoCarsPolicy) -> RecordingGroups | None:
    """Find the most significant two groups, or None where all recordings agree."""
    found = [cut for i, probe in enumerate(PROBES) for cut in _list_cuts(sizes, i, probe)
             if cut.ratio > policy.min_difference_stds
             and cut.high[0] - cut.low[0] > policy.min_difference_sizes * _medium_size(probe)
             and cut.high[0] - cut.low[0] > policy.min_spread_ratio * cut.within]
    return max(found, key=lambda cut: cut.ratio, default=None)


def _linearise(evidence: Evidence, point: Point
               ) -> tuple[FloatArray, FloatArray, FloatArray, RowLabels]:
    """Return residuals (N,), weights (N,), slopes (N, q) of the probes, and labels."""
    p = point.vehicle
    timing = point.timing
    noise = replace(point.noise, age_scale=1.0)  # that of the fit is of the training windows
    residuals = evidence.residuals(p, timing)
    r, weight = noise.stack(residuals)
    slopes = []
    for name in PROBES:
        step = PROBE_STEP * _medium_size(name)
        now = next((a.values[0] for a in p.effects if a.name == name),
                   catalogue()[name].parameters[0].null)
        moved = evidence.residuals(apply(p, name, k=now + step), timing)
        slopes.append((noise.stack(moved)[0] - r) / step)
    return (r, weight * noise.robust_weight(r), np.stack(slopes, axis=1),
            label_rows(evidence, residuals))


def _medium_size(name: str) -> float:
    """Return a medium size of an effect, in its unit."""
    return catalogue()[name].parameters[0].sizes[1]


def _list_cuts(sizes: SizesByRecording, i: int, probe: str) -> Iterator[RecordingGroups]:
    """List all cuts of the recordings into those with smaller and those with larger sizes."""
    order = np.argsort(sizes.size[:, i])
    for n in range(1, len(order)):
        smaller = order[:n]
        larger = order[n:]
        low, high = (_weighted_mean(sizes.size[part, i], sizes.error[part, i])
                     for part in (smaller, larger))
        within = np.concatenate([sizes.size[smaller, i] - low[0], sizes.size[larger, i] - high[0]])
        yield RecordingGroups(probe, low, high,
                              tuple(sizes.recordings[k] for k in sorted(smaller)),
                              tuple(sizes.recordings[k] for k in sorted(larger)),
                              float(np.abs(within).max(initial=0.0)))


def _weighted_mean(size: FloatArray, error: FloatArray) -> tuple[float, float]:
    """Return the weighted mean and its standard error, which grows with excess scatter."""
    weight = error**-2.0
    mean = float(weight @ size / weight.sum())
    excess = float(weight @ (size - mean)**2) / max(len(size) - 1, 1)
    return mean, float(np.sqrt(max(excess, 1.0) / weight.sum()))
