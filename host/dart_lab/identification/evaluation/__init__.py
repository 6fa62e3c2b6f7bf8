"""Open-loop prediction: how well a model says where the car will be in 0.5, 1 and 2 s.

``evaluate`` does it all. Its parts: ``prepare`` finds the windows, ``predict``
rolls them out, ``errors`` and ``score`` judge, ``gains`` compares two models,
``kinematic_limit`` says where rolling without slip ends. A model that is no
``Vehicle`` brings its own rollout: ``parts`` and ``AT`` give it the same
windows (``predict.rollout`` has their inputs), and ``errors`` takes its states.
"""

from __future__ import annotations

from dart_lab.identification.prediction.actuators import actuated
from dart_lab.identification.prediction.windows import HORIZONS

from .cases import Case, FileUse, Prepared, prepare, without
from .compare import Gain, gain, gains
from .prediction import (
    AT,
    CHANNELS,
    UNITS,
    dynamic,
    errors,
    hold,
    kinematic,
    measured,
    parts,
    predict,
)
from .run import Evaluation, evaluate
from .scores import Score, score
from .validity import KinematicLimit, kinematic_limit

__all__ = ["AT", "CHANNELS", "HORIZONS", "UNITS", "Case", "Evaluation", "FileUse", "Gain",
           "KinematicLimit", "Prepared", "Score", "actuated", "dynamic", "errors", "evaluate",
           "gain", "gains", "hold", "kinematic", "kinematic_limit", "measured", "parts",
           "predict", "prepare", "score", "without"]
