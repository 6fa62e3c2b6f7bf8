"""Spacing of a ring's edges, from the intervals of rolls at different speeds.

Each interval is divided by the mean of the turn around it and averaged over the turns. Marks that
stand uneven by a share g of the mean interval are seen as g at any speed. A force that swings once
a turn at the speed v swings it by dv/v = F / (m w v), w = 2 pi v / turn, thus as 1/v^2. What roll
k finds of an interval is therefore

    r_k = g + s / v_k^2 + e_k,    e_k by how its turns differ,    s by how the rolls differ

The s of all intervals have one variance, by moments (G. DerSimonian and N. Laird, "Meta-analysis
in clinical trials", 1986). Rolls that agree are averaged; rolls that do not are extrapolated to
where no force moves the wheel, and the standard error grows with that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.config.quantity import Quantities
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray
from dart_hal.estimation.ring import LearntRing, RingLearner

NEIGHBOURS = 4
"""Edges more or less than car.toml says that are tried: two marks missing or double."""
MISSING, DOUBLE = 1.6, 0.65
"""Intervals in units of the mean interval; printed teeth stay within 0.8 to 1.2."""


def ring_table(rolls: Sequence[RingLearner], edges_per_rev: int
               ) -> tuple[Quantities | None, tuple[str, ...]]:
    """(table of the ring or None, notes). Errors: CalibrationFailed for another number of edges."""
    try:
        near = range(max(2, edges_per_rev - NEIGHBOURS), edges_per_rev + NEIGHBOURS + 1)
        found = max(rolls, key=lambda roll: roll.intervals).period(near)
        rings = [roll.learn(found) for roll in rolls]
        if found != edges_per_rev and all(map(_is_even, rings)):
            found = edges_per_rev  # an even ring repeats with any period
            rings = [roll.learn(found) for roll in rolls]
    except ValueError as error:
        return None, (f"ring not measured: {error}",)
    fractions, std, swing = without_swing(rings)
    marks = odd_marks(fractions)
    if found != edges_per_rev:
        raise CalibrationFailed(
            f"the ring has {found} edges per revolution", found=marks or f"{found} edges",
            expected=f"{edges_per_rev}, as [encoder] edges_per_rev in car.toml says",
            likely="a mark is missing or counted twice: a broken tooth, dirt, a sensor too far",
            remedy=f"mend the ring, or write edges_per_rev = {found} in car.toml: its table then "
                   "takes care of the gap; run it again")
    turns = sum(ring.revolutions for ring in rings)
    repeats = np.sqrt(np.mean([ring.residual**2 for ring in rings]))
    notes = [f"ring of {found} edges uneven by {100 * float(np.std(fractions)):.1f} % rms, "
             f"{turns:.0f} turns, an interval repeats within {100 * repeats:.2f} %",
             *([f"caution: {marks}"] if marks else []),
             *([f"the speed swings in step with the ring, by {100 * swing:.2f} % on the slowest "
                "roll: taken off"] if swing > 2.0 * float(np.mean(std)) else [])]
    table = Quantities(tuple(round(float(f), 6) for f in fractions),
                       tuple(round(float(s), 6) for s in std),
                       f"{turns:.0f} turns, {len(rings)} rolls")
    return table, tuple(notes)


def without_swing(rings: Sequence[LearntRing]) -> tuple[FloatArray, FloatArray, float]:
    """(fractions (n,), their std (n,), rms swing of an interval on the slowest roll).

    rings: of each roll, which may begin at any mark.
    """
    first = rings[0].fractions
    shifts = [_shift(ring.fractions, first) for ring in rings]
    seen = np.array([np.roll(r.fractions, k) for r, k in zip(rings, shifts, strict=True)])
    noise = np.array([np.roll(r.std, k) for r, k in zip(rings, shifts, strict=True)]) ** 2
    slow = np.array([ring.interval for ring in rings])
    grows = (slow / slow.max()) ** 2
    swing = _variance_of_swing(seen, noise, grows)
    inverse = np.linalg.inv(np.eye(len(seen)) * noise.T[:, :, None]
                            + swing * np.outer(grows, grows))       # (n, rolls, rolls)
    weight = inverse.sum(axis=1)
    std = 1.0 / np.sqrt(weight.sum(axis=1))
    fractions = np.sum(weight * seen.T, axis=1) * std**2
    return fractions * (len(first) / fractions.sum()), std, float(np.sqrt(swing))


def _shift(fractions: FloatArray, to: FloatArray) -> int:
    """By how many marks a table is rolled onto another of the same ring."""
    return min(range(len(to)), key=lambda k: float(np.sum((np.roll(fractions, k) - to) ** 2)))


def _variance_of_swing(seen: FloatArray, noise: FloatArray, grows: FloatArray) -> float:
    """By what the rolls (k, n) differ beyond their noise (k, n); 0 where their speeds do not."""
    lever = grows - grows.mean()
    if not lever.any():
        return 0.0
    slope = lever @ seen / (lever @ lever)
    by_noise = lever**2 @ noise / (lever @ lever) ** 2
    return float(max(np.sum(slope**2) - np.sum(by_noise), 0.0) / (seen.shape[1] - 1))


def odd_marks(fractions: FloatArray) -> str:
    """Which intervals of the ring no whole mark makes; empty if there are none."""
    said = []
    for share in fractions.tolist():
        if share > MISSING:
            gone = max(round(share) - 1, 1)
            said.append(f"an interval of {share:.2f} times the mean: {gone} edge(s) missing there")
        elif share < DOUBLE:
            said.append(f"an interval of {share:.2f} times the mean: an edge too many there")
    return "; ".join(said)


def _is_even(ring: LearntRing) -> bool:
    return bool(np.std(ring.fractions) < 2.0 * ring.residual)
