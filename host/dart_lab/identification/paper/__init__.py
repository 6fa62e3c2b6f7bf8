"""The paper's sub-models with the paper's own preprocessing, by plain least squares.

For comparing with its published values, not for using: its preprocessing
differentiates across file joins, smooths half a sample late and rests on
settings made by hand. ``dart_lab.identification.submodels`` does it right.
"""

from __future__ import annotations

from .folders import FOLDERS, JoinedRows, read_folder
from .run import NAMES, AsPaper, as_paper, fit_as_paper

__all__ = ["FOLDERS", "NAMES", "AsPaper", "JoinedRows", "as_paper", "fit_as_paper", "read_folder"]
