"""Search over the size of one effect: which sizes to try, from the gains of those tried before.

A ladder of shares of the medium size comes first, then larger sizes while the best is the last
one, then bisection for an effect with a threshold, then parabolas through the best three.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effect import Effect, Parameter

from ..policy import USUAL, ScanPolicy


def scanned(effect: Effect) -> Sequence[Parameter]:
    """Parameters whose departure from null is an effect of its own."""
    return [p for p in effect.parameters if p.alone]


def settings_of(effect: Effect) -> Sequence[Mapping[str, float]]:
    """What else to try every size with: values of the parameters that are no effect alone."""
    beside = [q for q in effect.parameters if not q.alone]
    values = product(*((q.null, *(q.null + k for k in q.sizes)) for q in beside))
    return [dict(zip((q.name for q in beside), v, strict=True)) for v in values]


def ladder(p: Parameter, shares: Sequence[float] = USUAL.scan.ladder
           ) -> tuple[list[float], list[float]]:
    """Shares of the medium size, to both sides within the interval: near the null, and beyond."""
    steps = [[k for sign in (1.0, -1.0) if p.low <= (k := p.null + sign * share * p.sizes[1])
              <= p.high] for share in shares]
    return steps[0], [k for step in steps[1:] for k in step]


def needs_larger_sizes(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
                       policy: ScanPolicy) -> bool:
    """Whether sizes further from the null are to be tried; ``gains`` near it may grow by one.

    Not where the parabola of those near it promises next to nothing, nor where its
    top is near and gains what it promises. What is one-sided may begin beyond a threshold.
    """
    ks = sorted(gains)
    if len(ks) < 3:
        return True
    bend, slope, _ = np.polyfit([k - p.null for k in ks], [gains[k] for k in ks], 2)
    if not bend < 0.0:
        return True
    top, promised = -0.5 * slope / bend, -0.25 * slope**2 / bend
    if promised <= policy.faint:
        return False
    if abs(top) > policy.ladder[1] * p.sizes[1]:
        return True
    k = float(np.clip(p.null + top, p.low, p.high))
    gains[k] = gain(k)
    return bool(abs(gains[k] - promised) > policy.kept * promised)


def promises_gain(gains: Mapping[float, float], p: Parameter, changes: Mapping[float, FloatArray],
                  policy: ScanPolicy) -> bool:
    """Whether sizes that were tried before are to be tried again; gains: what each would gain.

    Always, where what they explain may have a threshold or several tops.
    """
    ks = sorted(gains, key=lambda k: abs(k - p.null))[:3]
    if p.tops or len(ks) < 3 or max(gains.values()) > policy.faint:
        return True
    if not p.low < p.null < p.high:
        near, far = (float(np.linalg.norm(changes[k])) for k in ks[1:])
        if near < policy.threshold * abs((ks[1] - p.null) / (ks[2] - p.null)) * far:
            return True
    bend, slope, _ = np.polyfit([k - p.null for k in ks], [gains[k] for k in ks], 2)
    top = np.clip(p.null - 0.5 * slope / bend, p.low, p.high) - p.null if bend < 0.0 else np.inf
    return bool(slope * top + bend * top**2 > policy.faint if bend < 0.0 else slope > 0.0)


def next_larger_size(gains: Mapping[float, float], p: Parameter, last: float) -> float | None:
    """Twice the best size, where that is the last of the ladder; None else."""
    best = max(gains, key=lambda k: gains[k])
    if best not in (min(gains), max(gains)) or abs(best - p.null) < last * p.sizes[1]:
        return None
    further = float(np.clip(p.null + 2.0 * (best - p.null), p.low, p.high))
    return None if further in gains else further


def find_onset(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
               moved: Callable[[float], float], policy: ScanPolicy) -> None:
    """Look for a threshold between a size that does next to nothing and one that does too much.

    A saturation beyond what a drive reaches changes nothing, a little below it cuts all that is
    above: what gains may be a narrow range between two rungs. Twice as far, an effect without a
    threshold does twice as much.
    """
    if p.low < p.null < p.high:
        return
    for _ in range(policy.bisections):
        ks = sorted(gains, key=lambda k: abs(k - p.null))
        further = next((i for i, k in enumerate(ks) if gains[k] < 0.0), 0)
        if further < 2 or max(gains.values()) > policy.faint:
            return
        near, far = ks[further - 1], ks[further]
        share = (near - p.null) / (far - p.null)
        if moved(near) > policy.threshold * share * moved(far):
            return
        gains[0.5 * (near + far)] = gain(0.5 * (near + far))


def refine_best_size(gains: dict[float, float], p: Parameter, gain: Callable[[float], float],
                     policy: ScanPolicy) -> None:
    """Go to the best size: by parabolas, and where one does not keep its promise by halves."""
    for _ in range(policy.refinements):
        bracket = bracket_best_size(gains)
        if bracket is None or gains[bracket[1]] <= policy.faint:
            return
        top, promised = parabola_top(gains, bracket)
        if top not in gains:
            gains[top] = gain(top)
        if gains[top] >= (1.0 - policy.met) * promised:
            return
        a, b, c = bracket_best_size(gains) or bracket
        wider = a if b - a > c - b else c
        if abs(wider - b) < policy.resolved * abs(b - p.null):
            return
        gains[0.5 * (b + wider)] = gain(0.5 * (b + wider))


def bracket_best_size(gains: Mapping[float, float]) -> tuple[float, float, float] | None:
    """The best size between its neighbours; None at an end."""
    ks = sorted(k for k, g in gains.items() if np.isfinite(g))
    at = max(range(len(ks)), key=lambda i: gains[ks[i]])
    return None if at in (0, len(ks) - 1) else (ks[at - 1], ks[at], ks[at + 1])


def parabola_top(gains: Mapping[float, float], bracket: tuple[float, float, float]
                 ) -> tuple[float, float]:
    """(top, its height) of the parabola through three sizes; the middle one where it is that."""
    a, b, c = bracket
    u, v, w = (gains[k] for k in bracket)
    bend, slope, _ = np.polyfit([a - b, 0.0, c - b], [u - v, 0.0, w - v], 2)
    if not bend < 0.0:
        return b, v
    top = b - 0.5 * slope / bend
    if min(abs(top - k) for k in bracket) < 1e-3 * (c - a):
        return b, v
    return float(np.clip(top, a, c)), float(v - 0.25 * slope**2 / bend)
