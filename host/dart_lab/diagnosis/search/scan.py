"""One effect at a time: how much of the residual would it take away, and at what size.

    gain(a) = J(x) - min over k, d of J(x + d, a = k)

k: size of effect a, over a ladder and a few parabola steps; d: what is free (base parameters,
effects found before, timing) follows r(a = k) to first order. J: see ``fit``.

What an effect does, r(a = k) - r, hardly changes from round to round, only what there is to explain
does: an effect whose change in the round before promises next to nothing now is not rolled out, and
where it promises a best size between others, only that one and what is next to it are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.errors import ConfigError
from dart_hal.core.process.jobs import each
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.readings import SENSORS
from ..evidence.residuals import Evidence, Residuals
from ..policy import USUAL, ScanPolicy
from .fit import Point
from .size_search import (
    bracket_best_size,
    find_onset,
    ladder,
    needs_larger_sizes,
    next_larger_size,
    promises_gain,
    refine_best_size,
    scanned,
    settings_of,
)

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Line:
    """One parameter of an effect with others beside it: change of the residuals by size.

    changes: by size (N,) in SI units, the motion row by row, then the sensors. Not whitened:
    a whitened residual has a limit, and where it is cut the change of it is lost for every later
    noise. A large cause that is found first would hide all smaller ones so.
    """

    parameter: Parameter
    beside: Mapping[str, float]
    changes: Mapping[float, NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class RecalledLine:
    """A line of the round before, whitened now. gains: by size, what that promises now."""

    line: Line
    changes: Mapping[float, FloatArray]
    gains: Mapping[float, float]


@dataclass(frozen=True, slots=True)
class Trial:
    """gain: drop of the robust loss; 1 is one squared standard deviation of one residual.

    residual (N,): whitened, at these values, before anything has moved along.
    lines: what was tried.
    """

    effect: str
    values: Mapping[str, float]
    gain: float
    residual: FloatArray
    lines: tuple[Line, ...] = ()


class Scan:
    """The gain of any effect over a fitted point."""

    def __init__(self, evidence: Evidence, point: Point, policy: ScanPolicy = USUAL.scan) -> None:
        self._evidence, self.point, self._policy = evidence, point, policy
        self._vehicle, self._timing = point.vehicle, point.timing
        self._plain = evidence.residuals(self._vehicle, self._timing)
        self._whitened = point.noise.stack(self._plain)[0]
        motion = len(evidence.motion_drive) * len(point.noise.motion)
        self._parts = (slice(0, motion), slice(motion, None))
        self._still = tuple(point.sums(point.residual, part) for part in self._parts)
        self._stands = tuple(self._lost(point.residual[part], part) for part in self._parts)
        # what has moved to the point may move on a little: judged by the same linear answer
        self.null = self._loss(point.residual)

    def residual(self, p: Vehicle) -> FloatArray:
        """Whitened residuals (N,) of a vehicle at the timing of the point."""
        return self._from_plain(self._evidence.residuals(p, self._timing))

    def _from_plain(self, plain: Residuals) -> FloatArray:
        """Whitened residuals (N,); what equals that of the point is so to the last bit."""
        return self.point.residual + (self.point.noise.stack(plain)[0] - self._whitened)

    def whitened(self, change: NDArray[np.float32]) -> FloatArray:
        """Change (N,) of the whitened residuals by one in SI units."""
        motion = self._plain.motion
        plain = Residuals(motion + change[:motion.size].reshape(motion.shape),
                          self._plain.sensors + change[motion.size:].reshape(-1, len(SENSORS)))
        return np.asarray(self.point.noise.stack(plain)[0] - self._whitened)

    def _loss(self, residual: FloatArray) -> float:
        """Once all that is free has followed; what an effect leaves as it is is known already."""
        point = self.point
        same = [np.array_equal(residual[p], point.residual[p]) for p in self._parts]
        every = [still if unchanged else point.sums(residual, part)
                 for part, still, unchanged in zip(self._parts, self._still, same, strict=True)]
        move = point.step(every[0].normal + every[1].normal, every[0].slope + every[1].slope)
        total = point.prior(move)
        for i, part in enumerate(self._parts):
            total += (self._stands[i] + every[i].rise(move) if same[i]
                      else self._lost(residual[part] + point.jacobian[part] @ move, part))
        return total

    def _lost(self, r: FloatArray, part: slice) -> float:
        """Robust loss of residuals of a part."""
        return float(self.point.weight[part] @ self.point.noise.loss(r))

    def _guess(self, residual: FloatArray) -> float:
        """``_loss`` with the normal matrix of the point: a little too high, at a third of the cost.

        What is free moves a little beside the best where an effect changes which residuals are
        large; that is missed by the square of how much.
        """
        point = self.point
        weighted = point.weight * point.noise.robust_weight(residual) * residual
        move = point.step(self._still[0].normal + self._still[1].normal,
                          point.jacobian.T @ weighted)
        return self._lost(residual + point.jacobian @ move, slice(None)) + point.prior(move)

    def gain(self, residual: FloatArray) -> float:
        """By how much the loss drops with other residuals (N,)."""
        return self.null - self._loss(residual)

    def _moved(self, residual: FloatArray) -> float:
        """By how much residuals (N,) differ from those of the point, in standard deviations."""
        return float(np.sqrt(self.point.weight @ (residual - self.point.residual)**2))

    def best(self, name: str, before: Sequence[RecalledLine] = ()) -> Trial:
        """The size of an effect that takes away most; before: what other sizes did before."""
        effect = catalogue()[name]
        found, lines = Trial(name, {}, 0.0, self.point.residual), list[Line]()
        known = {(b.line.parameter.name, *b.line.beside.values()): b for b in before}
        for parameter in scanned(effect):
            for beside in settings_of(effect):
                one = known.get((parameter.name, *beside.values()))
                trial = (one and self._near(effect, one)) or self._along(
                    effect, parameter, beside)
                lines += trial.lines
                found = trial if trial.gain > found.gain else found
        return replace(found, lines=tuple(lines))

    def tried(self, one: tuple[str, Sequence[RecalledLine]]) -> Trial:
        """``best`` of (name, what was tried before)."""
        return self.best(*one)

    def again(self, name: str, known: Sequence[RecalledLine]) -> Trial | None:
        """The same from what other sizes did before; None where that promises anything."""
        found = Trial(name, {}, 0.0, self.point.residual)
        for one in known:
            if promises_gain(one.gains, one.line.parameter, one.changes, self._policy):
                return None
            k = max(one.gains, key=lambda k: one.gains[k])
            if k in one.changes:
                values = {**one.line.beside, one.line.parameter.name: k}
                found = max(found, Trial(name, values, one.gains[k], self.point.residual
                                         + one.changes[k]), key=lambda t: t.gain)
        return replace(found, lines=tuple(one.line for one in known))

    def recalled(self, line: Line) -> RecalledLine:
        """A line of the round before, with the gain by size that it promises now."""
        changes = {k: self.whitened(d) for k, d in line.changes.items()}
        return RecalledLine(line, changes, self.promised(line.parameter, changes))

    def promised(self, parameter: Parameter, changes: Mapping[float, FloatArray]
                 ) -> dict[float, float]:
        """Gain by size, from what each does to the whitened residuals."""
        return {parameter.null: 0.0,
                **{k: self.null - self._guess(self.point.residual + d)
                   for k, d in changes.items()}}

    def _near(self, effect: Effect, recalled: RecalledLine) -> Trial | None:
        """From the best size by what was tried before; None where that may lead astray.

        That is where it is the last one tried, or explains something with several tops, or where
        the car does not keep what was promised.
        """
        line, promised = recalled.line, recalled.gains
        p, at = line.parameter, bracket_best_size(promised)
        gain, kept, _ = self._gain_of(effect, p, line.beside)
        if p.tops or at is None or promised[at[1]] <= self._policy.faint:
            return None
        gains = dict(promised)
        refine_best_size(gains, p, gain, self._policy)
        best = max(gains, key=lambda k: gains[k])
        if best not in kept:
            gains[best] = gain(best)
        if abs(gains[best] - promised[at[1]]) > self._policy.known * promised[at[1]]:
            return None
        return Trial(effect.name, {**line.beside, p.name: best}, gains[best], kept[best], (line,))

    def _gain_of(self, effect: Effect, parameter: Parameter, beside: Mapping[str, float]
                 ) -> tuple[Callable[[float], float], dict[float, FloatArray],
                            dict[float, Residuals]]:
        """(gain by size, whitened and plain residuals of every size that it was asked for)."""
        kept: dict[float, FloatArray] = {parameter.null: self.point.residual}
        plain: dict[float, Residuals] = {}

        def gain(k: float) -> float:
            try:
                vehicle = apply(self._vehicle, effect.name, **{**beside, parameter.name: k})
                plain[k] = self._evidence.residuals(vehicle, self._timing)
            except ConfigError:  # the effect leads out of what a car can be
                return -np.inf
            kept[k] = self._from_plain(plain[k])
            return self.gain(kept[k])

        return gain, kept, plain

    def _along(self, effect: Effect, parameter: Parameter,
               beside: Mapping[str, float]) -> Trial:
        gain, kept, plain = self._gain_of(effect, parameter, beside)

        def moved(k: float) -> float:
            return self._moved(kept[k]) if k in kept else np.inf

        near, far = ladder(parameter, self._policy.dense if parameter.tops else self._policy.ladder)
        gains = {parameter.null: 0.0, near[0]: gain(near[0])}
        if len(near) == 1 or not self._faint_on_both_sides(parameter, near[0], kept):
            gains |= {k: gain(k) for k in near[1:]}
            if needs_larger_sizes(gains, parameter, gain, self._policy):
                gains |= {k: gain(k) for k in far}
            while (k := next_larger_size(gains, parameter, self._policy.ladder[-1])) is not None:
                gains[k] = gain(k)
            find_onset(gains, parameter, gain, moved, self._policy)
            refine_best_size(gains, parameter, gain, self._policy)
        best, around = max(gains, key=lambda k: gains[k]), bracket_best_size(gains)
        known = (*near, *(around or ()), *(() if around and len(near) > 1 else far[:2]))
        return Trial(effect.name, {**beside, parameter.name: best}, gains[best], kept[best],
                     (self._line(parameter, beside, plain, known),))

    def _faint_on_both_sides(self, p: Parameter, k: float, kept: Mapping[float, FloatArray]
                             ) -> bool:
        """Whether next to nothing is promised if the other side does the opposite of size k."""
        if k not in kept:
            return False
        change = kept[k] - self.point.residual
        changes = {k: change, 2.0 * p.null - k: -change}
        return not promises_gain(self.promised(p, changes), p, changes, self._policy)

    def _plain_change(self, plain: Residuals) -> NDArray[np.float32]:
        """Change (N,) in SI units; 0 where nothing was read."""
        parts = (plain.motion - self._plain.motion, plain.sensors - self._plain.sensors)
        change = np.concatenate([part.ravel() for part in parts])
        return np.asarray(np.nan_to_num(change, nan=0.0, posinf=0.0, neginf=0.0),
                          dtype=np.float32)

    def _line(self, p: Parameter, beside: Mapping[str, float], plain: Mapping[float, Residuals],
              ks: Sequence[float]) -> Line:
        """What sizes did; the other side the opposite where it was not tried."""
        changes = {k: self._plain_change(plain[k]) for k in ks if k in plain and k != p.null}
        if len(changes) == 1 and p.low < p.null < p.high:
            (k, change), = changes.items()
            changes[2.0 * p.null - k] = -change
        return Line(p, beside, changes)


def scan(evidence: Evidence, point: Point, names: Sequence[str] | None = None,
         progress: Progress | None = None, jobs: int = 1, policy: ScanPolicy = USUAL.scan,
         before: Mapping[str, Sequence[Line]] = MappingProxyType({})) -> list[Trial]:
    """Every effect alone, the one that takes away most first; effects of the point left out.

    jobs: processes; None of what comes out depends on it. before: by effect, what was tried in
    the round before.
    """
    work = Scan(evidence, point, policy)
    has = {a.name for a in point.vehicle.effects}
    wanted = [n for n in (catalogue() if names is None else names) if n not in has]
    known = {n: [work.recalled(line) for line in before[n]] for n in wanted if before.get(n)}
    trials = [t for t in (work.again(name, lines) for name, lines in known.items()) if t]
    done = {t.effect for t in trials}
    todo = [(n, known.get(n, ())) for n in wanted if n not in done]
    for trial in each(work.tried, todo, jobs):
        trials.append(trial)
        if progress is not None:
            progress(len(trials) / len(wanted), trial.effect)
    # in single precision: there are many of them, and they are long
    return sorted((replace(t, residual=t.residual.astype(np.float32)) for t in trials),
                  key=lambda t: (-t.gain, t.effect))
