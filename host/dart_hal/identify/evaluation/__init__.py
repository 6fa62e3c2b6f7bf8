"""Open-loop prediction: how well a model says where the car will be in 0.5, 1 and 2 s.

``evaluate`` does it all. Its parts: ``prepare`` finds the windows, ``predict``
rolls them out, ``errors`` and ``score`` judge, ``gains`` compares two models,
``kinematic_limit`` says where rolling without slip ends.
"""

from __future__ import annotations

from .cases import Case, FileUse, Prepared, prepare, without
from .compare import Gain, gain, gains
from .prediction import CHANNELS, UNITS, dynamic, errors, hold, kinematic, measured, predict
from .run import Evaluation, evaluate
from .scores import Score, score
from .validity import KinematicLimit, kinematic_limit
from .windows import HORIZONS

__all__ = ["CHANNELS", "HORIZONS", "UNITS", "Case", "Evaluation", "FileUse", "Gain",
           "KinematicLimit", "Prepared", "Score", "dynamic", "errors", "evaluate", "gain",
           "gains", "hold", "kinematic", "kinematic_limit", "measured", "predict", "prepare",
           "score", "without"]
