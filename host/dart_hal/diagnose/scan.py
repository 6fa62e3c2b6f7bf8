"""One effect at a time: how much of the residual would it take away, and at what size.

Timing of the sensors, and where asked for the base parameters, move along:
their linear answer to every trial is part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.errors import ConfigError
from dart_hal.types import FloatArray
from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from .noise import Noise, loss, weight
from .residuals import Evidence

LADDER = (0.35, 1.0, 2.2)  # of the medium size
LATE_PRIOR = 0.008  # s; how well the age of the sensor messages is known
LATE_STEP = 0.002  # s
SETTLE = 4  # rounds for the age of the messages
REFINE = 2  # parabola steps after the ladder


Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Trial:
    """gain: drop of the robust loss; 1 is one squared standard deviation of one residual."""

    effect: str
    values: Mapping[str, float]
    gain: float


class Scan:
    """The residuals of a base model, what may move along, and the gain of any effect."""

    def __init__(self, evidence: Evidence, base: Vehicle, noise: Noise) -> None:
        self.evidence, self.base, self.noise = evidence, base, noise
        self.late, self._moves = 0.0, np.empty((0, 1))
        for _ in range(SETTLE):  # the age of the messages is no cause, so it is found first
            self.residual, self.worth = noise.stacked(evidence.residuals(base, self.late))
            other, _ = noise.stacked(evidence.residuals(base, self.late + LATE_STEP))
            self._moves = ((other - self.residual) / LATE_STEP * LATE_PRIOR)[:, None]
            self.late += LATE_PRIOR * float(self._moved(self.residual)[0])
        self.residual, self.worth = noise.stacked(evidence.residuals(base, self.late))
        self.null = self._loss(self.residual)

    def _moved(self, x: FloatArray) -> FloatArray:
        """Where what may move along goes, (k,), in prior standard deviations from here."""
        weights = self.worth * weight(x)
        already = np.array([self.late / LATE_PRIOR])
        normal = (self._moves * weights[:, None]).T @ self._moves + np.eye(len(already))
        return np.asarray(-np.linalg.solve(normal, self._moves.T @ (weights * x) + already))

    def _loss(self, x: FloatArray) -> float:
        """Robust loss after what may move along has moved."""
        moved = self._moved(x)
        total = moved + self.late / LATE_PRIOR
        return float(self.worth @ loss(x + self._moves @ moved) + total @ total)

    def gain(self, p: Vehicle) -> float:
        """Of a vehicle against the base."""
        x, _ = self.noise.stacked(self.evidence.residuals(p, self.late))
        return self.null - self._loss(x)

    def best(self, name: str) -> Trial:
        """The size of an effect that takes away most."""
        effect = catalogue()[name]
        found = Trial(name, {}, 0.0)
        for parameter in scanned(effect):
            trial = self._along(effect, parameter)
            found = trial if trial.gain > found.gain else found
        return found

    def _along(self, effect: Effect, parameter: Parameter) -> Trial:
        def gain(k: float) -> float:
            try:
                return self.gain(apply(self.base, effect.name, **{parameter.name: k}))
            except ConfigError:  # the effect leads out of what a car can be
                return -np.inf

        steps = ladder(parameter)
        gains = {k: gain(k) for k in steps} | {parameter.null: 0.0}
        for _ in range(REFINE):
            k = _peak(gains, parameter)
            if k is None:
                break
            gains[k] = gain(k)
        best = max(gains, key=lambda k: gains[k])
        return Trial(effect.name, {parameter.name: best}, gains[best])


def scanned(effect: Effect) -> Sequence[Parameter]:
    """Parameters whose departure from null is an effect of its own (not the phase of one)."""
    return [p for p in effect.parameters if p.name != "phase"]


def ladder(p: Parameter) -> list[float]:
    """Sizes to try, to both sides where the interval allows."""
    trials = [p.null + sign * share * p.sizes[1] for share in LADDER for sign in (1.0, -1.0)]
    return [k for k in trials if p.low <= k <= p.high]


def _peak(gains: Mapping[float, float], p: Parameter) -> float | None:
    """Top of the parabola through the best size and its neighbours; None at an end."""
    ks = sorted(k for k, g in gains.items() if np.isfinite(g))
    at = max(range(len(ks)), key=lambda i: gains[ks[i]])
    if at in (0, len(ks) - 1):
        return None
    a, b, c = ks[at - 1:at + 2]
    u, v, w = (gains[k] for k in (a, b, c))
    under = (b - a) * (v - w) - (b - c) * (v - u)
    if under == 0.0:
        return None
    top = b - 0.5 * ((b - a)**2 * (v - w) - (b - c)**2 * (v - u)) / under
    known = min(abs(top - k) for k in ks) < 1e-3 * (c - a)
    return None if known or not a < top < c else float(np.clip(top, p.low, p.high))


def scan(evidence: Evidence, base: Vehicle, noise: Noise, names: Sequence[str] | None = None,
         progress: Progress | None = None) -> list[Trial]:
    """Every effect alone, the one that takes away most first."""
    work = Scan(evidence, base, noise)
    wanted = list(catalogue() if names is None else names)
    trials = []
    for i, name in enumerate(wanted):
        if progress is not None:
            progress(i / len(wanted), name)
        trials.append(work.best(name))
    return sorted(trials, key=lambda t: (-t.gain, t.effect))
