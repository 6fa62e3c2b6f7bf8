"""Fit the spacing of the ring's edges to the intervals of rolls at different speeds.

Each interval is divided by the mean of the turn around it, and averaged over the turns. A mark that
is uneven by a share g of the mean interval gives g at any speed. A force F that oscillates once a
turn at the speed v changes the speed by dv/v = F / (m w v), with w = 2 pi v / turn, so by 1/v^2.
Roll k therefore measures for an interval

    r_k = g + s / v_k^2 + e_k

where e_k follows from the differences between its turns, and s from the differences between rolls.
The s of all intervals have one variance, estimated by moments (G. DerSimonian and N. Laird,
"Meta-analysis in clinical trials", 1986). Rolls that agree are averaged. Others are extrapolated to
the speed at which no force matters, and the standard error grows accordingly.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.config.quantity import Quantities
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray
from dart_hal.estimation.ring import LearntRing, RingLearner

# Numbers of edges that are tried around that of car.toml: two marks missing or double.
MAX_EDGE_COUNT_ERROR = 4
# Intervals in units of the mean interval; printed teeth stay within 0.8 to 1.2.
MISSING_MARK = 1.6
DOUBLE_MARK = 0.65


def make_ring_table(rolls: Sequence[RingLearner], edges_per_rev: int
                    ) -> tuple[Quantities | None, tuple[str, ...]]:
    """Return (table of the ring, or None if it could not be measured; notes).

    Raises CalibrationFailed for another number of edges than ``edges_per_rev``.
    """
    try:
        counts = range(max(2, edges_per_rev - MAX_EDGE_COUNT_ERROR),
                       edges_per_rev + MAX_EDGE_COUNT_ERROR + 1)
        found = max(rolls, key=lambda roll: roll.intervals).period(counts)
        rings = [roll.learn(found) for roll in rolls]
        if found != edges_per_rev and all(map(_is_even, rings)):
            found = edges_per_rev  # an even ring repeats with any period
            rings = [roll.learn(found) for roll in rolls]
    except ValueError as error:
        return None, (f"ring not measured: {error}",)
    fractions, std, swing = remove_swing(rings)
    marks = describe_odd_marks(fractions)
    if found != edges_per_rev:
        raise CalibrationFailed(
            f"the ring has {found} edges per revolution", found=marks or f"{found} edges",
            expected=f"{edges_per_rev}, as [encoder] edges_per_rev in car.toml states",
            likely="a mark is missing or counted twice: a broken tooth, dirt, a sensor too far",
            remedy=f"repair the ring, or write edges_per_rev = {found} in car.toml (the table then "
                   "corrects the gap); run it again")
    turns = sum(ring.revolutions for ring in rings)
    repeats = np.sqrt(np.mean([ring.residual**2 for ring in rings]))
    notes = [f"ring of {found} edges uneven by {100 * float(np.std(fractions)):.1f} % rms, "
             f"{turns:.0f} turns, an interval repeats within {100 * repeats:.2f} %",
             *([f"caution: {marks}"] if marks else []),
             *([f"the speed oscillates once per turn of the ring, by {100 * swing:.2f} % on the "
                "slowest roll: removed"] if swing > 2.0 * float(np.mean(std)) else [])]
    table = Quantities(tuple(round(float(f), 6) for f in fractions),
                       tuple(round(float(s), 6) for s in std),
                       f"{turns:.0f} turns, {len(rings)} rolls")
    return table, tuple(notes)


def remove_swing(rings: Sequence[LearntRing]) -> tuple[FloatArray, FloatArray, float]:
    """Combine the rings of all rolls, which may start at any mark.

    1. Rotate the tables so that they start at the same mark.
    2. Estimate the variance of the oscillation s from the differences between rolls.
    3. Average by generalised least squares with the covariance noise + variance x growth growth^T.

    Returns (fractions (n,), their std (n,), rms oscillation of an interval on the slowest roll).
    """
    first = rings[0].fractions
    shifts = [_find_shift(ring.fractions, first) for ring in rings]
    measured = np.array([np.roll(r.fractions, k) for r, k in zip(rings, shifts, strict=True)])
    noise = np.array([np.roll(r.std, k) for r, k in zip(rings, shifts, strict=True)]) ** 2
    interval = np.array([ring.interval for ring in rings])
    growth = (interval / interval.max()) ** 2
    swing = _swing_variance(measured, noise, growth)
    inverse = np.linalg.inv(np.eye(len(measured)) * noise.T[:, :, None]
                            + swing * np.outer(growth, growth))       # (n, rolls, rolls)
    weight = inverse.sum(axis=1)
    std = 1.0 / np.sqrt(weight.sum(axis=1))
    fractions = np.sum(weight * measured.T, axis=1) * std**2
    return fractions * (len(first) / fractions.sum()), std, float(np.sqrt(swing))


def _find_shift(fractions: FloatArray, reference: FloatArray) -> int:
    """Number of marks by which a table has to be rolled to match the reference."""
    return min(range(len(reference)),
               key=lambda k: float(np.sum((np.roll(fractions, k) - reference) ** 2)))


def _swing_variance(measured: FloatArray, noise: FloatArray, growth: FloatArray) -> float:
    """Variance between the rolls (k, n) beyond their noise (k, n); 0 if all speeds are equal."""
    lever = growth - growth.mean()
    if not lever.any():
        return 0.0
    slope = lever @ measured / (lever @ lever)
    noise_part = lever**2 @ noise / (lever @ lever) ** 2
    return float(max(np.sum(slope**2) - np.sum(noise_part), 0.0) / (measured.shape[1] - 1))


def describe_odd_marks(fractions: FloatArray) -> str:
    """Describe the intervals that no single mark explains; empty if there are none."""
    found = []
    for share in fractions.tolist():
        if share > MISSING_MARK:
            missing = max(round(share) - 1, 1)
            found.append(f"an interval of {share:.2f} times the mean: {missing} edge(s) missing "
                         "there")
        elif share < DOUBLE_MARK:
            found.append(f"an interval of {share:.2f} times the mean: an edge too many there")
    return "; ".join(found)


def _is_even(ring: LearntRing) -> bool:
    return bool(np.std(ring.fractions) < 2.0 * ring.residual)
