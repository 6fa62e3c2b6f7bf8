"""Remove from residuals what is a function of the drive: the remainder is noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import replace_diverged
from dart_lab.identification.evidence.policy import CLIP
from dart_lab.identification.evidence.residuals import Evidence, Residuals

from ..policy import TAIL
from .bases import basis_functions
from .crossfit import FOLDS, MIN_SIGN_BLOCKS, predict_held_out
from .features import exogenous, window_features

# Variables of vehicle models. The prediction is a sum of one function of each.
MODEL_VARIABLES = ("speed", "steering_angle", "lateral_acceleration", "throttle", "direction")
# Samples by which a window is described, as in the search for structure.
WINDOW_SAMPLES = READ_OUTS[2]


def remove_driven_motion(evidence: Evidence, p: Vehicle, r: Residuals) -> Residuals:
    """Subtract from the motion what functions of MODEL_VARIABLES predict on held-out blocks.

    Columns that they do not predict are unchanged, all columns if there are too few blocks.
    """
    return replace(r, motion=remove_driven(evidence, p, r.motion, WINDOW_SAMPLES))


def remove_driven(evidence: Evidence, p: Vehicle, errors: FloatArray, span: int
                  ) -> FloatArray:
    """Subtract from errors (n, c) of the windows what functions of MODEL_VARIABLES predict.

    span: samples by which a window is described. See ``remove_driven_motion``.
    """
    block = np.unique(evidence.blocks()[0], return_inverse=True)[1]
    if not len(block) or block.max() + 1 < MIN_SIGN_BLOCKS:
        return errors
    features = exogenous(p, window_features(evidence, p, span))
    columns = np.hstack([basis_functions(features, (name,), TAIL) for name in MODEL_VARIABLES])
    fold = np.random.default_rng(0).permutation(np.arange(block.max() + 1) % FOLDS)[block]
    finite = replace_diverged(errors)
    return np.stack([_subtract_prediction(y, columns, fold) for y in finite.T], axis=1)


def _subtract_prediction(y: FloatArray, columns: FloatArray, fold: IntArray
                         ) -> FloatArray:
    """Subtract the held-out prediction by functions (n, d) from y (n,), if it reduces y."""
    centred = y - np.median(y)
    size = MAD_TO_SIGMA * float(np.median(np.abs(centred))) + 1e-6
    x = np.clip(centred / size, -CLIP, CLIP)
    prediction = predict_held_out(columns, x, fold)
    return np.asarray(y - size * prediction if np.sum((x - prediction)**2) < x @ x else y)
