"""Scan: the loss reduction and the best size of every effect, one at a time.

    gain(a) = J(x) - min over k, d of J(x + d, a = k)

k: size of effect a, over a ladder and a few parabola steps; d: step of the free coordinates (base
parameters, effects found before, timing), which follow r(a = k) to first order. J: see ``fit``.

The change r(a = k) - r hardly depends on the round. It is therefore kept. In the next round an
effect whose kept change predicts a negligible gain is not simulated again; if it predicts a best
size between two others, only that size and its neighbours are simulated.
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
from dart_hal.vehicle.effects import apply, catalogue, effect_for, is_applicable
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.readings import SENSORS
from dart_lab.identification.evidence.residuals import Evidence, Residuals
from dart_lab.identification.objective import Point

from ..policy import USUAL, ScanPolicy
from .size_search import (
    LADDER,
    bracket_best_size,
    companion_values,
    find_onset,
    ladder,
    needs_larger_sizes,
    next_larger_size,
    predicts_gain,
    refine_best_size,
    scanned_parameters,
)

Progress = Callable[[float, str], None]
# Share of the gain that the changes of the last round predict: if the gain found differs by more,
# all sizes are tried again (Shamanskii).
SLOPE_TOLERANCE = 0.25


@dataclass(frozen=True, slots=True)
class Sweep:
    """Sweep over one parameter of an effect: change of the residuals by size.

    fixed: values of the other parameters. changes: by size (N,) in SI units, the motion row by row,
    then the sensors. They are not whitened: whitened residuals are clipped, and a change of a
    clipped residual would be lost for the noise of later rounds. A large cause could then mask
    smaller ones.
    """

    parameter: Parameter
    fixed: Mapping[str, float]
    changes: Mapping[float, NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class RecalledSweep:
    """Sweep of the round before, whitened now. gains: predicted gain by size."""

    sweep: Sweep
    changes: Mapping[float, FloatArray]
    gains: Mapping[float, float]


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect at its best size.

    gain: reduction of the robust loss; 1 is one squared standard deviation of one residual.
    residual (N,): whitened, at these values, before the free coordinates are re-fitted.
    sweeps: the sizes that were tried.
    """

    effect: str
    values: Mapping[str, float]
    gain: float
    residual: FloatArray
    sweeps: tuple[Sweep, ...] = ()


class EffectScan:
    """Computes the gain of effects at a fitted point."""

    def __init__(self, evidence: Evidence, point: Point, policy: ScanPolicy = USUAL.scan) -> None:
        self._evidence = evidence
        self.point = point
        self._policy = policy
        self._vehicle = point.vehicle
        self._timing = point.timing
        self._plain = evidence.residuals(self._vehicle, self._timing)
        self._whitened = point.noise.stack(self._plain)[0]
        # Motion and sensors separately: most effects change only one of the two.
        motion = len(evidence.motion_drive) * len(point.noise.motion)
        self._parts = (slice(0, motion), slice(motion, None))
        self._null_equations = tuple(point.normal_equations(point.residual, part)
                                     for part in self._parts)
        self._null_losses = tuple(self._data_loss(point.residual[part], part)
                                  for part in self._parts)
        # The point may not be an exact minimum: its loss is computed with the same linear step.
        self.null_loss = self._refitted_loss(point.residual)

    def residual(self, p: Vehicle) -> FloatArray:
        """Whitened residuals (N,) of a vehicle at the timing of the point."""
        return self._from_plain(self._evidence.residuals(p, self._timing))

    def _from_plain(self, plain: Residuals) -> FloatArray:
        """Whiten residuals (N,); rows that equal those of the point stay equal to the last bit."""
        return self.point.residual + (self.point.noise.stack(plain)[0] - self._whitened)

    def whiten_change(self, change: NDArray[np.float32]) -> FloatArray:
        """Convert a change (N,) of the residuals from SI units to whitened units."""
        motion = self._plain.motion
        plain = Residuals(motion + change[:motion.size].reshape(motion.shape),
                          self._plain.sensors + change[motion.size:].reshape(-1, len(SENSORS)))
        return np.asarray(self.point.noise.stack(plain)[0] - self._whitened)

    def _refitted_loss(self, residual: FloatArray) -> float:
        """Loss of other residuals after the linear step of the free coordinates."""
        point = self.point
        # Parts (motion, sensors) that the effect does not change are taken from the constructor.
        same = [np.array_equal(residual[p], point.residual[p]) for p in self._parts]
        equations = [null if unchanged else point.normal_equations(residual, part) for part, null,
                     unchanged in zip(self._parts, self._null_equations, same, strict=True)]
        move = point.bounded_step(equations[0].normal + equations[1].normal,
                                  equations[0].gradient + equations[1].gradient)
        total = point.prior_loss(move)
        for i, part in enumerate(self._parts):
            total += (self._null_losses[i] + equations[i].loss_change(move) if same[i]
                      else self._data_loss(residual[part] + point.jacobian[part] @ move, part))
        return total

    def _data_loss(self, r: FloatArray, part: slice) -> float:
        """Robust loss of the residuals of a part, without the prior."""
        return float(self.point.weight[part] @ self.point.noise.loss(r))

    def _approximate_loss(self, residual: FloatArray) -> float:
        """``_refitted_loss`` with the normal matrix of the point: a third of the cost.

        The matrix changes where an effect changes which residuals are large. The error of the loss
        is of second order in the resulting error of the step.
        """
        point = self.point
        weighted = point.weight * point.noise.robust_weight(residual) * residual
        move = point.bounded_step(self._null_equations[0].normal + self._null_equations[1].normal,
                          point.jacobian.T @ weighted)
        return self._data_loss(residual + point.jacobian @ move,
                               slice(None)) + point.prior_loss(move)

    def gain(self, residual: FloatArray) -> float:
        """Reduction of the loss by other residuals (N,)."""
        return self.null_loss - self._refitted_loss(residual)

    def _change_norm(self, residual: FloatArray) -> float:
        """Weighted distance of residuals (N,) from those of the point, in standard deviations."""
        return float(np.sqrt(self.point.weight @ (residual - self.point.residual)**2))

    def best_trial(self, name: str, previous: Sequence[RecalledSweep] = ()) -> Trial:
        """Find the size with the largest gain; previous: sweeps of the round before."""
        effect = effect_for(self._vehicle, name)
        found = Trial(name, {}, 0.0, self.point.residual)
        sweeps = list[Sweep]()
        known = {(b.sweep.parameter.name, *b.sweep.fixed.values()): b for b in previous}
        for parameter in scanned_parameters(effect):
            for fixed in companion_values(effect):
                one = known.get((parameter.name, *fixed.values()))
                trial = (one and self._refine_recalled(effect, one)) or self._sweep_parameter(
                    effect, parameter, fixed)
                sweeps += trial.sweeps
                found = trial if trial.gain > found.gain else found
        return replace(found, sweeps=tuple(sweeps))

    def run_item(self, item: tuple[str, Sequence[RecalledSweep]]) -> Trial:
        """``best_trial`` of (name, sweeps of the round before), for ``each``."""
        return self.best_trial(*item)

    def recall_trial(self, name: str, known: Sequence[RecalledSweep]) -> Trial | None:
        """The trial by the sweeps of the round before; None if one of them predicts a gain."""
        found = Trial(name, {}, 0.0, self.point.residual)
        for one in known:
            if predicts_gain(one.gains, one.sweep.parameter, one.changes, self._policy):
                return None
            k = max(one.gains, key=lambda k: one.gains[k])
            if k in one.changes:
                values = {**one.sweep.fixed, one.sweep.parameter.name: k}
                found = max(found, Trial(name, values, one.gains[k], self.point.residual
                                         + one.changes[k]), key=lambda t: t.gain)
        return replace(found, sweeps=tuple(one.sweep for one in known))

    def recall_sweep(self, sweep: Sweep) -> RecalledSweep:
        """Whiten a sweep of the round before and predict its gains."""
        changes = {k: self.whiten_change(d) for k, d in sweep.changes.items()}
        return RecalledSweep(sweep, changes, self.predict_gains(sweep.parameter, changes))

    def predict_gains(self, parameter: Parameter, changes: Mapping[float, FloatArray]
                 ) -> dict[float, float]:
        """Predict the gain by size, from the changes (N,) of the whitened residuals."""
        return {parameter.null: 0.0,
                **{k: self.null_loss - self._approximate_loss(self.point.residual + d)
                   for k, d in changes.items()}}

    def _refine_recalled(self, effect: Effect, recalled: RecalledSweep) -> Trial | None:
        """Refine the best size of the round before; None if a full sweep is needed.

        That is so if it is the largest size, if the effect may have several local maxima, or if the
        gain is not as predicted.
        """
        sweep = recalled.sweep
        predicted = recalled.gains
        p = sweep.parameter
        bracket = bracket_best_size(predicted)
        gain, whitened, _ = self._make_gain_function(effect, p, sweep.fixed)
        if p.tops or bracket is None or predicted[bracket[1]] <= self._policy.min_predicted_loss:
            return None
        gains = dict(predicted)
        refine_best_size(gains, p, gain, self._policy)
        best = max(gains, key=lambda k: gains[k])
        if best not in whitened:
            gains[best] = gain(best)
        expected = predicted[bracket[1]]
        if abs(gains[best] - expected) > SLOPE_TOLERANCE * expected:
            return None
        return Trial(effect.name, {**sweep.fixed, p.name: best}, gains[best], whitened[best],
                     (sweep,))

    def _make_gain_function(self, effect: Effect, parameter: Parameter, fixed: Mapping[str, float]
                 ) -> tuple[Callable[[float], float], dict[float, FloatArray],
                            dict[float, Residuals]]:
        """Return the function from size to gain, and the residuals that it has computed.

        Returns (gain by size, whitened residuals by size, residuals in SI units by size).
        """
        whitened: dict[float, FloatArray] = {parameter.null: self.point.residual}
        plain: dict[float, Residuals] = {}

        def gain(k: float) -> float:
            try:
                vehicle = apply(self._vehicle, effect.name, **{**fixed, parameter.name: k})
                plain[k] = self._evidence.residuals(vehicle, self._timing)
            except ConfigError:  # the vehicle has no valid parameters with this size
                return -np.inf
            whitened[k] = self._from_plain(plain[k])
            return self.gain(whitened[k])

        return gain, whitened, plain

    def _sweep_parameter(self, effect: Effect, parameter: Parameter,
                         fixed: Mapping[str, float]) -> Trial:
        """Sweep the size of an effect over one parameter, and return its best trial."""
        gain, whitened, plain = self._make_gain_function(effect, parameter, fixed)

        def change_norm(k: float) -> float:
            return self._change_norm(whitened[k]) if k in whitened else np.inf

        # 1. The smallest steps of the ladder, on both sides.
        near, far = ladder(parameter)
        gains = {parameter.null: 0.0, near[0]: gain(near[0])}
        # 2. Unless both sides predict a negligible gain: larger sizes, a threshold, the maximum.
        if len(near) == 1 or not self._is_negligible_on_both_sides(parameter, near[0], whitened):
            gains |= {k: gain(k) for k in near[1:]}
            if needs_larger_sizes(gains, parameter, gain, self._policy):
                gains |= {k: gain(k) for k in far}
            while (k := next_larger_size(gains, parameter, LADDER[-1])) is not None:
                gains[k] = gain(k)
            find_onset(gains, parameter, gain, change_norm, self._policy)
            refine_best_size(gains, parameter, gain, self._policy)
        # 3. Keep the changes at the best size, its neighbours and the ladder for the next round.
        best = max(gains, key=lambda k: gains[k])
        bracket = bracket_best_size(gains)
        known = (*near, *(bracket or ()), *(() if bracket and len(near) > 1 else far[:2]))
        return Trial(effect.name, {**fixed, parameter.name: best}, gains[best], whitened[best],
                     (self._make_sweep(parameter, fixed, plain, known),))

    def _is_negligible_on_both_sides(self, p: Parameter, k: float,
                                     whitened: Mapping[float, FloatArray]
                             ) -> bool:
        """Check that size k and the opposite change predict a negligible gain."""
        if k not in whitened:
            return False
        change = whitened[k] - self.point.residual
        changes = {k: change, 2.0 * p.null - k: -change}
        return not predicts_gain(self.predict_gains(p, changes), p, changes, self._policy)

    def _plain_change(self, plain: Residuals) -> NDArray[np.float32]:
        """Change (N,) of the residuals in SI units; 0 for missing readings."""
        parts = (plain.motion - self._plain.motion, plain.sensors - self._plain.sensors)
        change = np.concatenate([part.ravel() for part in parts])
        return np.asarray(np.nan_to_num(change, nan=0.0, posinf=0.0, neginf=0.0),
                          dtype=np.float32)

    def _make_sweep(self, p: Parameter, fixed: Mapping[str, float],
                    plain: Mapping[float, Residuals], ks: Sequence[float]) -> Sweep:
        """Collect the changes by size; a side that was not tried gets the opposite of the other."""
        changes = {k: self._plain_change(plain[k]) for k in ks if k in plain and k != p.null}
        if len(changes) == 1 and p.low < p.null < p.high:
            (k, change), = changes.items()
            changes[2.0 * p.null - k] = -change
        return Sweep(p, fixed, changes)


def scan(evidence: Evidence, point: Point, names: Sequence[str] | None = None,
         progress: Progress | None = None, jobs: int = 1, policy: ScanPolicy = USUAL.scan,
         previous: Mapping[str, Sequence[Sweep]] = MappingProxyType({})) -> list[Trial]:
    """Try every effect alone and sort by gain, largest first; effects of the point are excluded.

    jobs: number of processes; the result does not depend on it. previous: by effect, its sweeps of
    the round before.
    """
    work = EffectScan(evidence, point, policy)
    present = {a.name for a in point.vehicle.effects}
    requested = [n for n in (catalogue() if names is None else names)
                 if n not in present and is_applicable(catalogue()[n], point.vehicle)]
    known = {n: [work.recall_sweep(sweep) for sweep in previous[n]] for n in requested
             if previous.get(n)}
    trials = [t for t in (work.recall_trial(name, sweeps) for name, sweeps in known.items()) if t]
    done = {t.effect for t in trials}
    remaining = [(n, known.get(n, ())) for n in requested if n not in done]
    for trial in each(work.run_item, remaining, jobs):
        trials.append(trial)
        if progress is not None:
            progress(len(trials) / len(requested), trial.effect)
    # Single precision: there are up to a hundred trials with some 10,000 residuals each.
    return sorted((replace(t, residual=t.residual.astype(np.float32)) for t in trials),
                  key=lambda t: (-t.gain, t.effect))
