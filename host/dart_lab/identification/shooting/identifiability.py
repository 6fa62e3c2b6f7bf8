"""Which parameters recordings determine, before any fit: errors by the slopes at a start model.

With the Jacobian J of the scaled residuals at the start, and a prior of variance 1 in each
coordinate, the covariance of a fit will be about

    C = (J' J / b + I)^-1,    b: read-outs that say the same as one independent error

The residuals are scaled by the errors of a typical first model, so the prediction is cautious.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.dart.grid import grid
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.coordinates import Coordinates

from .fit import FIRST_ERRORS, FREE, MAX_IDENTIFIED_STD, PRIOR_SCALE, _JointProblem, free_names
from .problem import ShootingProblem

# Manoeuvre that determines the parameters of a sub-model, in words, for any car.
MANOEUVRES = {
    "friction": "let the car coast to a stop from several speeds, straight on",
    "motor": "step the throttle from standstill to several levels, straight on",
    "steering": "drive slow circles at several steering commands, left and right",
    "delay": "step the steering and the throttle at constant speed, ten times each",
    "tyres": "drive circles of rising speed until the car slides, left and right",
}


@dataclass(frozen=True, slots=True)
class Identifiability:
    """Prediction for one parameter.

    name: "group.key". std: predicted standard error of a fit, in ``unit``. determined: the data
    alone give it better than a third of what is usual without data. manoeuvre: what would.
    """

    name: str
    value: float
    std: float
    unit: str
    determined: bool
    manoeuvre: str


def predict_identifiability(recordings: Sequence[Recording], base: Vehicle,
                            reference: Reference | None = None,
                            known: Mapping[str, float] | None = None
                            ) -> tuple[Identifiability, ...]:
    """Predict the standard errors of a joint fit to recordings with motion capture.

    base: start model; known: standard errors of its parameters by "group.key".
    Raises RecordingError if a recording cannot be predicted.
    """
    problem = ShootingProblem.from_grids([grid(r, reference, base.body.l_r, turning=True)
                                          for r in recordings])
    names = free_names(base, tuple(FREE))
    space = Coordinates(base, names, known or {})
    scale = np.broadcast_to(np.array(FIRST_ERRORS)[:, None], (*problem.measured.shape[:2], 1))
    slopes = _JointProblem(problem, space, base.body.l_r, None).jacobian(space.first, scale)
    relative = np.linalg.inv(PRIOR_SCALE**2 * slopes.T @ slopes + np.eye(len(names)))
    std = np.sqrt(np.diag(relative))
    # Remove the information of the prior, 1 in each coordinate.
    by_data = 1.0 / np.sqrt(np.maximum(std**-2 - 1.0, np.finfo(float).tiny))
    slope = space.slope(space.first)
    determined = by_data * slope < MAX_IDENTIFIED_STD * space.usual(space.first)
    return tuple(Identifiability(
        name, float(value(base, name)), float(std[i] * slope[i]), unit(base, name),
        bool(determined[i]), MANOEUVRES[name.partition(".")[0]]) for i, name in enumerate(names))
