"""The steering map of the paper's form, with tyre slip taken out by its dependence on v^2.

At the same angle a faster car turns less (or more): atan(l W/v) = delta -
kappa v^2 sin(2 delta)/2. With kappa known the map is that of v -> 0 and not
of the speed that was driven.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from dart_hal.fitting.covariance import collinearity, leverage_covariance
from dart_hal.fitting.least_squares import Solution, least_squares
from dart_hal.fitting.robust import scatter
from dart_hal.identify.fit import Estimate, Fit
from dart_hal.identify.submodels.blocks import independent_blocks
from dart_hal.identify.submodels.groups import cautions, groups_of
from dart_hal.identify.submodels.paper_form import HIGH, LOW, PRIOR_STD, TYPICAL, curve
from dart_hal.identify.submodels.report import UNITS, Ledger, untold
from dart_hal.identify.submodels.samples import IntArray, Samples, concatenate
from dart_hal.identify.submodels.slip import slip_of
from dart_hal.identify.submodels.steady import MAX_LATERAL, SLOW, steady_samples
from dart_hal.recording.dart import Recording, Reference
from dart_hal.types import FloatArray
from dart_hal.vehicle import Vehicle

NOISE = 0.02  # rad; the scale at which a prior weighs as much as one sample
ROBUST = 3.0  # times the robust scatter
LEVELS, SPAN = 4, 0.2  # commands that a map needs
REACHED = 0.3  # of command; a side with less tells no curvature
MOST = {"k_left": 0.3, "a_left_rad": 0.2, "a_right_rad": 0.2, "k_right": 0.3}
MOST_S0 = 0.03


def fit_steering(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
                 ledger: Ledger) -> Fit:
    """The five parameters; what the commands do not reach is held by a weak prior and said."""
    begin = time.process_time()
    parts: list[tuple[Recording, Samples, FloatArray]] = []
    for recording in recordings:
        found = steady_samples(recording, base.body.wheelbase, reference, ledger)
        if found is not None:
            parts.append((recording, *found))
    held = {n: float(getattr(base.steering, n)) for n in UNITS["steering"]}
    if not parts:
        return untold("steering", held, [f"no recording turns at more than {SLOW} m/s"])
    samples = concatenate([s for _, s, _ in parts])
    why = _too_little(samples)
    if why:
        return untold("steering", held, [why], time.process_time() - begin)
    square = np.concatenate([q for _, _, q in parts])
    owner = np.repeat(np.arange(len(parts)), [len(s) for _, s, _ in parts])
    slip = slip_of(samples, square, owner)
    solution = _solve(samples, square, slip[0])
    covariance = _covariance(solution, samples, square, owner, slip[1])
    said = _notes(parts, samples, square, solution, slip)
    return _fit(samples, solution, covariance, said, time.process_time() - begin)


def _too_little(samples: Samples) -> str:
    levels = np.unique(np.round(samples.command / 0.025))
    span = float(np.ptp(samples.command))
    if len(levels) < LEVELS or span < SPAN:
        return (f"{len(levels)} steering level(s) over a span of {span:.2f}, at least {LEVELS} "
                f"over {SPAN} needed")
    slope = float(np.cov(samples.command, samples.angle)[0, 1])
    return "" if slope > 0.0 else "the car turns right where the command is left: sign of W?"


def _solve(samples: Samples, square: FloatArray, kappa: float) -> Solution:
    """x (5,) at a given kappa; the weak prior is 5 rows at the end."""
    def residual(p: FloatArray) -> FloatArray:
        delta = curve(p, samples.command)
        data = delta - 0.5 * kappa * square * np.sin(2.0 * delta) - samples.angle
        return np.concatenate([data, NOISE * (p - TYPICAL) / PRIOR_STD])

    bounds = (LOW.tolist(), HIGH.tolist())
    plain = least_squares(residual, TYPICAL.tolist(), bounds)
    scale = scatter(plain.residual)
    return least_squares(residual, plain.x.tolist(), bounds, robust=ROBUST * max(scale, 1e-4))


def _covariance(s: Solution, samples: Samples, square: FloatArray, owner: IntArray,
                kappa_std: float) -> FloatArray:
    """(5, 5) from whole recordings, or from blocks of one held command.

    The rows of the prior are blocks of their own; what kappa's error does to
    the map is added.
    """
    block = independent_blocks(owner, samples.block)
    out = leverage_covariance(s, np.append(block, block.max() + 1 + np.arange(5)))
    delta = curve(s.x, samples.command)
    effect = np.append(-0.5 * square * np.sin(2.0 * delta), np.zeros(5))
    weighted = s.jacobian * s.weight[:, None]
    shift = np.linalg.pinv(weighted.T @ s.jacobian) @ (weighted.T @ effect) * kappa_std
    return np.asarray(out + np.outer(shift, shift))


def _fit(samples: Samples, s: Solution, covariance: FloatArray, notes: list[str],
         cpu_s: float) -> Fit:
    units = UNITS["steering"]
    reach = {"left": float(samples.command.max()), "right": float(-samples.command.min())}
    independent = collinearity(s)
    out = {}
    for i, (name, unit) in enumerate(units.items()):
        value, std = float(s.x[i]), float(np.sqrt(covariance[i, i]))
        side = next((reach[k] for k in reach if k in name), 1.0)
        limit = MOST[name] * abs(value) if name in MOST else MOST_S0
        told = std < limit and side > REACHED and independent[i] > 0.01
        out[name] = Estimate(value, std, unit, bool(told))
    residual = s.residual[:len(samples)]
    stopped = tuple(n for n, edge in zip(units, s.at_bound, strict=True) if edge)
    return Fit("steering", out, covariance, len(samples),
               float(np.sqrt(np.mean(residual**2))), "rad", s.converged, stopped, cpu_s,
               tuple(notes))


def _notes(parts: Sequence[tuple[Recording, Samples, FloatArray]], samples: Samples,
           square: FloatArray, s: Solution, slip: tuple[float, float]) -> list[str]:
    speed = np.sqrt(square)
    out = [f"commands {samples.command.min():+.2f} to {samples.command.max():+.2f} at "
           f"{speed.min():.2f} to {speed.max():.2f} m/s, below {MAX_LATERAL} m/s2",
           f"slip taken out: kappa {slip[0]:+.3f} +- {slip[1]:.3f} s2/m2, so the map is that of "
           f"v -> 0; as the paper does it, without this, {_without(samples)}"]
    for side, reach in (("left", samples.command.max()), ("right", -samples.command.min())):
        if reach < REACHED:
            out.append(f"nothing beyond {reach:+.2f} on the {side}: its curve is the prior's")
    residual = -s.residual[:len(samples)]
    ends = np.cumsum([len(part) for _, part, _ in parts])[:-1]
    triples = [(r, part.command, rest) for (r, part, _), rest
               in zip(parts, np.split(residual, ends), strict=True)]
    return [*out, *cautions(groups_of(triples))]


def _without(samples: Samples) -> str:
    x = _solve(samples, np.zeros(len(samples)), 0.0).x
    return ", ".join(f"{n} {v:.3f}" for n, v in zip(UNITS["steering"], x, strict=True))
