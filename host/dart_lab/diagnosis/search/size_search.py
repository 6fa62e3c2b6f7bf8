"""Search over the size of one effect: which size to try next, given the gains so far.

1. A ladder of multiples of the medium size.
2. Larger sizes while the largest one is the best.
3. Bisection, for an effect with a threshold.
4. Parabolas through the best three sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effect import Effect, Parameter

from ..policy import ScanPolicy

# Shares of the medium size that are tried: small, medium, large.
LADDER = (0.35, 1.0, 2.2)
# The same for effects whose gain has several maxima over their size: steps of a fifth.
DENSE_LADDER = (0.35, 0.45, 0.55, 0.65, 0.8, 0.95, 1.1, 1.3, 1.6, 1.9, 2.2)
# Share of the gain that a parabola predicts at its maximum: if the gain found there differs by
# less, larger sizes are not tried.
PEAK_TOLERANCE = 0.05
# Parabola steps after the ladder; most end after one, as predicted.
MAX_REFINEMENTS = 6
# Share of a predicted gain: if at most so much of it is missing, the search for the size ends.
PREDICTION_TOLERANCE = 0.02
# Share of a size, between the best size and the next one that is tried.
MIN_SIZE_STEP = 0.1
# Bisections of an interval of sizes in which an effect may set in: to 1 / 32 of it.
MAX_BISECTIONS = 5
# Share of the change in proportion to that by a larger size: below, an effect may set in between.
MIN_PROPORTION = 0.5


def scanned_parameters(effect: Effect) -> Sequence[Parameter]:
    """Parameters of an effect that are scanned: those whose departure from null is an effect."""
    return [p for p in effect.parameters if p.alone]


def companion_values(effect: Effect) -> Sequence[Mapping[str, float]]:
    """Combinations of values of the other parameters, for each of which the size is scanned."""
    companions = [q for q in effect.parameters if not q.alone]
    values = product(*((q.null, *(q.null + k for k in q.sizes)) for q in companions))
    return [dict(zip((q.name for q in companions), v, strict=True)) for v in values]


def ladder(p: Parameter) -> tuple[list[float], list[float]]:
    """Sizes (near the null, beyond) at shares of the medium size, on both sides."""
    shares = DENSE_LADDER if p.tops else LADDER
    steps = [[k for sign in (1.0, -1.0) if p.low <= (k := p.null + sign * share * p.sizes[1])
              <= p.high] for share in shares]
    return steps[0], [k for step in steps[1:] for k in step]


def needs_larger_sizes(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
                       policy: ScanPolicy) -> bool:
    """Decide whether sizes beyond the first step of the ladder are tried; may add one to ``gains``.

    Not if the parabola through the sizes near the null predicts a negligible gain, nor if its
    maximum is near and the gain there is as predicted. One-sided parameters always continue: the
    effect may begin beyond a threshold.
    """
    ks = sorted(gains)
    if len(ks) < 3:
        return True
    curvature, slope = _parabola([k - p.null for k in ks], [gains[k] for k in ks])
    if not curvature < 0.0:
        return True
    maximum = -0.5 * slope / curvature
    predicted = -0.25 * slope**2 / curvature
    if predicted <= policy.min_predicted_loss:
        return False
    if abs(maximum) > LADDER[1] * p.sizes[1]:
        return True
    # The maximum is near: try it, and trust the parabola if the gain is as predicted.
    k = float(np.clip(p.null + maximum, p.low, p.high))
    gains[k] = gain(k)
    return bool(abs(gains[k] - predicted) > PEAK_TOLERANCE * predicted)


def predicts_gain(gains: Mapping[float, float], p: Parameter, changes: Mapping[float, FloatArray],
                  policy: ScanPolicy) -> bool:
    """Decide whether an effect is tried again; gains: prediction for the sizes of the round before.

    Always if it may have a threshold or several local maxima.
    """
    ks = sorted(gains, key=lambda k: abs(k - p.null))[:3]
    if p.tops or len(ks) < 3 or max(gains.values()) > policy.min_predicted_loss:
        return True
    if not p.low < p.null < p.high:
        # One-sided: the change grows less than in proportion, so there may be a threshold.
        near, far = (float(np.linalg.norm(changes[k])) for k in ks[1:])
        if near < MIN_PROPORTION * abs((ks[1] - p.null) / (ks[2] - p.null)) * far:
            return True
    # Maximum of the parabola gain(k) = slope k + curvature k^2 within the bounds.
    curvature, slope = _parabola([k - p.null for k in ks], [gains[k] for k in ks])
    maximum = np.clip(p.null - 0.5 * slope / curvature, p.low,
                      p.high) - p.null if curvature < 0.0 else np.inf
    return bool(slope * maximum + curvature * maximum**2 > policy.min_predicted_loss
                if curvature < 0.0 else slope > 0.0)


def next_larger_size(gains: Mapping[float, float], p: Parameter, last: float) -> float | None:
    """Twice the best size, if that is the last of the ladder; otherwise None."""
    best = max(gains, key=lambda k: gains[k])
    if best not in (min(gains), max(gains)) or abs(best - p.null) < last * p.sizes[1]:
        return None
    larger = float(np.clip(p.null + 2.0 * (best - p.null), p.low, p.high))
    return None if larger in gains else larger


def find_onset(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
               change_norm: Callable[[float], float], policy: ScanPolicy) -> None:
    """Bisect for a threshold between a size that is too small and one that is too large.

    Example: a saturation above the largest input of the drive changes nothing, one slightly below
    it clips all larger inputs. The sizes with a gain can be a narrow range between two steps. An
    effect without a threshold changes the residuals in proportion to its size.
    """
    if p.low < p.null < p.high:
        return
    for _ in range(MAX_BISECTIONS):
        ks = sorted(gains, key=lambda k: abs(k - p.null))
        # First size with a loss, and the size before it.
        larger = next((i for i, k in enumerate(ks) if gains[k] < 0.0), 0)
        if larger < 2 or max(gains.values()) > policy.min_predicted_loss:
            return
        near = ks[larger - 1]
        far = ks[larger]
        share = (near - p.null) / (far - p.null)
        if change_norm(near) > MIN_PROPORTION * share * change_norm(far):
            return
        gains[0.5 * (near + far)] = gain(0.5 * (near + far))


def refine_best_size(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
                     policy: ScanPolicy) -> None:
    """Find the best size: by parabolas, and by bisection if a parabola predicts a wrong gain."""
    for _ in range(MAX_REFINEMENTS):
        bracket = bracket_best_size(gains)
        if bracket is None or gains[bracket[1]] <= policy.min_predicted_loss:
            return
        maximum, predicted = parabola_maximum(gains, bracket)
        if maximum not in gains:
            gains[maximum] = gain(maximum)
        if gains[maximum] >= (1.0 - PREDICTION_TOLERANCE) * predicted:
            return
        # The prediction failed: halve the wider side of the bracket.
        a, b, c = bracket_best_size(gains) or bracket
        wider = a if b - a > c - b else c
        if abs(wider - b) < MIN_SIZE_STEP * abs(b - p.null):
            return
        gains[0.5 * (b + wider)] = gain(0.5 * (b + wider))


def bracket_best_size(gains: Mapping[float, float]) -> tuple[float, float, float] | None:
    """The best size between its two neighbours; None if it is the first or last."""
    ks = sorted(k for k, g in gains.items() if np.isfinite(g))
    index = max(range(len(ks)), key=lambda i: gains[ks[i]])
    return None if index in (0, len(ks) - 1) else (ks[index - 1], ks[index], ks[index + 1])


def parabola_maximum(gains: Mapping[float, float], bracket: tuple[float, float, float]
                 ) -> tuple[float, float]:
    """Location and height of the maximum of the parabola through three sizes.

    Returns the middle size if the maximum is closer than 0.1 % of the bracket to one of the three.
    """
    a, b, c = bracket
    u, v, w = (gains[k] for k in bracket)
    curvature, slope = _parabola([a - b, 0.0, c - b], [u - v, 0.0, w - v])
    if not curvature < 0.0:
        return b, v
    maximum = b - 0.5 * slope / curvature
    if min(abs(maximum - k) for k in bracket) < 1e-3 * (c - a):
        return b, v
    return float(np.clip(maximum, a, c)), float(v - 0.25 * slope**2 / curvature)


def _parabola(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Curvature and slope at 0 of the parabola through three points, by divided differences."""
    (a, b, c), (u, v, w) = x, y
    first = (v - u) / (b - a)
    curvature = ((w - v) / (c - b) - first) / (c - a)
    return curvature, first - curvature * (a + b)
