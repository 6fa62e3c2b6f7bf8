"""Open-loop prediction: errors of a model after 0.5, 1 and 2 s.

``evaluate`` does it all. Its parts: ``prepare`` finds the windows, ``predict``
rolls them out, ``errors`` and ``score`` compute errors, ``gains`` compares two models,
``kinematic_limit`` finds where rolling without slip ends. A model that is no
``Vehicle`` brings its own rollout: ``parts`` and ``AT`` give it the same
windows (``predict.rollout`` has their inputs), and ``errors`` takes its states.
"""

from __future__ import annotations

from dart_lab.identification.prediction.actuators import actuator_outputs
from dart_lab.identification.prediction.windows import HORIZONS

from .cases import Case, FileUse, Prepared, prepare
from .compare import Gain, gain, gains
from .prediction import (
    CHANNELS,
    ERROR_UNITS,
    HORIZON_OFFSETS,
    dynamic,
    errors,
    kinematic,
    measured,
    parts,
    predict,
    predict_ctrv,
)
from .run import Evaluation, evaluate
from .scores import Score, score
from .validity import KinematicLimit, kinematic_limit

__all__ = [
    "CHANNELS",
    "ERROR_UNITS",
    "HORIZONS",
    "HORIZON_OFFSETS",
    "Case",
    "Evaluation",
    "FileUse",
    "Gain",
    "KinematicLimit",
    "Prepared",
    "Score",
    "actuator_outputs",
    "dynamic",
    "errors",
    "evaluate",
    "gain",
    "gains",
    "kinematic",
    "kinematic_limit",
    "measured",
    "parts",
    "predict",
    "predict_ctrv",
    "prepare",
    "score",
]
