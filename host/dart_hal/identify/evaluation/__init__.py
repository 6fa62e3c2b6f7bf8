"""Open-loop prediction: how well a model says where the car will be in 0.5, 1 and 2 s.

``evaluate`` does it all. Its parts: ``prepare`` finds the windows, ``predict``
rolls them out, ``errors`` and ``score`` judge, ``gains`` compares two models,
``kinematic_limit`` says where rolling without slip ends. A model that is no
``Vehicle`` brings its own rollout: ``starts``, ``joined``, ``windowed`` and
``AT`` give it the same windows, and ``errors`` takes its states.
"""

from __future__ import annotations

from dart_hal.identify.commands import actuated

from .cases import Case, FileUse, Prepared, prepare, without
from .compare import Gain, gain, gains
from .prediction import (
    AT,
    CHANNELS,
    UNITS,
    dynamic,
    errors,
    hold,
    joined,
    kinematic,
    measured,
    predict,
    starts,
    windowed,
)
from .run import Evaluation, evaluate
from .scores import Score, score
from .validity import KinematicLimit, kinematic_limit
from .windows import HORIZONS

__all__ = ["AT", "CHANNELS", "HORIZONS", "UNITS", "Case", "Evaluation", "FileUse", "Gain",
           "KinematicLimit", "Prepared", "Score", "actuated", "dynamic", "errors", "evaluate",
           "gain", "gains", "hold", "joined", "kinematic", "kinematic_limit", "measured",
           "predict", "prepare", "score", "starts", "windowed", "without"]
