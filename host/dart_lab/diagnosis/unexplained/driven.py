"""Residuals without what goes with the driving: what is left of them is noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.drive import READ_OUTS
from ..evidence.noise import replace_diverged
from ..evidence.residuals import Evidence, Residuals
from ..policy import CLIP, TAIL, BlockPolicy, UnexplainedPolicy
from .bases import basis
from .crossfit import held_out
from .features import exogenous, window_features

ALONG = ("speed", "steering_angle", "lateral_acceleration", "throttle", "direction")
"""Variables that models of a car are made of; a function of each, added up."""
SPAN = READ_OUTS[2]
"""Samples over which a window is described, as where structure is looked for."""


def undriven(evidence: Evidence, p: Vehicle, r: Residuals, policy: UnexplainedPolicy) -> Residuals:
    """With the motion less what functions of ALONG predict of it, on blocks left out.

    A column that they do not predict is as it was; with too few blocks every one is.
    """
    return replace(r, motion=remove_driven(evidence, p, r.motion, SPAN, policy))


def remove_driven(evidence: Evidence, p: Vehicle, errors: FloatArray, span: int,
                  policy: UnexplainedPolicy) -> FloatArray:
    """Subtract from errors (n, c) of the windows what functions of ALONG predict, see ``undriven``.

    span: samples over which a window is described.
    """
    block = np.unique(evidence.blocks(BlockPolicy().seconds)[0], return_inverse=True)[1]
    if not len(block) or block.max() + 1 < policy.least_blocks:
        return errors
    features = exogenous(p, window_features(evidence, p, span), policy.straight)
    columns = np.hstack([basis(features, (name,), TAIL) for name in ALONG])
    fold = np.random.default_rng(0).permutation(np.arange(block.max() + 1) % policy.folds)[block]
    finite = replace_diverged(errors)
    return np.stack([_without(y, columns, fold, policy) for y in finite.T], axis=1)


def _without(y: FloatArray, columns: FloatArray, fold: IntArray,
             policy: UnexplainedPolicy) -> FloatArray:
    """One column (n,) of the motion, and functions (n, d) that may predict it."""
    away = y - np.median(y)
    size = MAD_TO_SIGMA * float(np.median(np.abs(away))) + 1e-6
    x = np.clip(away / size, -CLIP, CLIP)
    said = held_out(columns, x, fold, policy.ridge)
    return np.asarray(y - size * said if np.sum((x - said)**2) < x @ x else y)
