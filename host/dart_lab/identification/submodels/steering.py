"""The steering map of the paper's form, with tyre slip removed by its dependence on v^2.

At the same angle a faster car turns less (or more):

    atan(l omega / v) = delta(s) - kappa v^2 sin(2 delta) / 2

With kappa known, the map is that of v -> 0 and not of the speeds that were driven.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from dart_hal.calibration.samples import Samples, concatenate
from dart_hal.calibration.sessions import cautions, make_groups
from dart_hal.calibration.steering_map import (
    MIN_LEVELS,
    MIN_SPAN,
    PaperMap,
    coverage,
    fit_map,
)
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle, make_steering
from dart_hal.vehicle.fitting.covariance import collinearity, select_blocks
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.scale import find_scale
from dart_hal.vehicle.steering import is_straight
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.submodels.report import PARAMETER_UNITS, Ledger, make_unidentified
from dart_lab.identification.submodels.steady import (
    MAX_STEADY_LATERAL,
    MIN_STEADY_SPEED,
    steady_samples,
)
from dart_lab.identification.submodels.understeer import estimate_slip_with_prior

# Largest command on a side below which its curvature is not identified.
MIN_SIDE_COMMAND = 0.3
# Largest standard error over value of an identified parameter.
MAX_MAP_RELATIVE_STD = {"k_left": 0.3, "a_left_rad": 0.2, "a_right_rad": 0.2, "k_right": 0.3}
# Selections of samples by the fitted map, until all that remain are slow enough.
MAX_SELECTIONS = 5
# [command] The value of s0 may be 0.
MAX_STD_S0 = 0.03


def fit_steering(recordings: Sequence[Recording], reference: Reference | None, base: Vehicle,
                 ledger: Ledger) -> SubmodelFit:
    """Fit the five parameters; a weak prior replaces commands that were not driven."""
    begin = time.process_time()
    parts: list[tuple[Recording, Samples, FloatArray]] = []
    for recording in recordings:
        found = steady_samples(recording, base.body.wheelbase, reference, ledger)
        if found is not None:
            parts.append((recording, *found))
    base_values = {n: float(getattr(base.steering, n)) for n in PARAMETER_UNITS["steering"]}
    scale = find_scale(base.body)
    if not parts:
        least = MIN_STEADY_SPEED * scale.speed
        return make_unidentified("steering", base_values,
                                 [f"no recording turns at more than {least:.2g} m/s"])
    samples = concatenate([s for _, s, _ in parts])
    square = np.concatenate([q for _, _, q in parts])
    owner = np.repeat(np.arange(len(parts)), [len(s) for _, s, _ in parts])
    for remaining in reversed(range(MAX_SELECTIONS)):
        why = _why_too_little(samples)
        if why:
            return make_unidentified("steering", base_values, [why], time.process_time() - begin)
        slip = estimate_slip_with_prior(samples, square, owner, scale)
        fitted = fit_map(samples, block=select_blocks(owner, samples.block), square=square,
                         understeer=slip, robust=True)
        # A sample is selected by the lateral acceleration that its command leads to, by the base's
        # map and by the fitted one. By the measured one, a fast car counts only while it does not
        # turn yet.
        angle = np.maximum(np.abs(fitted.angle(samples.command)),
                           np.abs(make_steering(base.steering, np)(samples.command)))
        slow = square * np.tan(angle) / base.body.wheelbase < MAX_STEADY_LATERAL
        if slow.all() or not remaining:
            break
        samples, square, owner = samples.select(slow), square[slow], owner[slow]
    notes = _notes([r for r, _, _ in parts], owner, samples, square, fitted.solution, slip)
    return _make_fit(samples, fitted, notes, time.process_time() - begin)


def _why_too_little(samples: Samples) -> str:
    levels, span, rising = coverage(samples)
    if levels < MIN_LEVELS or span < MIN_SPAN:
        return (f"{levels} steering level(s) over a span of {span:.2f}, at least {MIN_LEVELS} "
                f"over {MIN_SPAN} needed")
    return "" if rising else "the car turns right where the command is left: sign of W?"


def _make_fit(samples: Samples, found: PaperMap, notes: list[str], cpu_s: float) -> SubmodelFit:
    s = found.solution
    covariance = found.covariance
    units = PARAMETER_UNITS["steering"]
    reach = {"left": float(samples.command.max()), "right": float(-samples.command.min())}
    independent = collinearity(s)
    out = {}
    for i, (name, unit) in enumerate(units.items()):
        value = float(s.x[i])
        std = float(np.sqrt(covariance[i, i]))
        side = next((reach[k] for k in reach if k in name), 1.0)
        relative = MAX_MAP_RELATIVE_STD.get(name)
        limit = MAX_STD_S0 if relative is None else relative * abs(value)
        known = std < limit and side > MIN_SIDE_COMMAND and independent[i] > 0.01
        out[name] = FittedParameter(value, std, unit, bool(known))
    residual = s.residual[:len(samples)]
    # The amplitude of a straight line is not determined: its bound is no error of the fit.
    stopped = tuple(n for n, edge in zip(units, s.at_bound, strict=True)
                    if edge and not is_straight(n, found.as_dict()))
    return SubmodelFit("steering", out, covariance, len(samples),
                       float(np.sqrt(np.mean(residual**2))), "rad", s.converged, stopped, cpu_s,
                       tuple(notes))


def _notes(recordings: Sequence[Recording], owner: IntArray, samples: Samples,
           square: FloatArray, s: Solution, slip: tuple[float, float]) -> list[str]:
    speed = np.sqrt(square)
    out = [f"commands {samples.command.min():+.2f} to {samples.command.max():+.2f} at "
           f"{speed.min():.2f} to {speed.max():.2f} m/s, below {MAX_STEADY_LATERAL} m/s2",
           f"slip removed: kappa {slip[0]:+.3f} +- {slip[1]:.3f} s2/m2, so the map is that of "
           f"v -> 0; as the paper does it, without this, {_describe_uncorrected(samples)}"]
    for side, reach in (("left", samples.command.max()), ("right", -samples.command.min())):
        if reach < MIN_SIDE_COMMAND:
            out.append(f"nothing beyond {reach:+.2f} on the {side}: its curve is the prior's")
    residual = -s.residual[:len(samples)]
    triples = [(recording, samples.command[owner == i], residual[owner == i])
               for i, recording in enumerate(recordings) if np.any(owner == i)]
    return [*out, *cautions(make_groups(triples))]


def _describe_uncorrected(samples: Samples) -> str:
    return ", ".join(f"{n} {v:.3f}" for n, v in fit_map(samples, robust=True).as_dict().items())
