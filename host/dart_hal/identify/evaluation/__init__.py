"""Open-loop prediction: how well a model says where the car will be in 0.5, 1 and 2 s.

``prepare`` finds the windows, ``predict`` rolls them out, ``errors`` and
``score`` judge, ``gains`` compares two models.
"""

from __future__ import annotations

from .cases import Case, FileUse, Prepared, prepare, without
from .compare import Gain, gain, gains
from .predict import CHANNELS, UNITS, errors, hold, kinematic, measured, predict
from .score import Score, score
from .windows import HORIZONS

__all__ = ["CHANNELS", "HORIZONS", "UNITS", "Case", "FileUse", "Gain", "Prepared", "Score",
           "errors", "gain", "gains", "hold", "kinematic", "measured", "predict", "prepare",
           "score", "without"]
