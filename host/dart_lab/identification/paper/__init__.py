"""The paper's sub-models with the paper's own preprocessing, by plain least squares.

For comparison with its published values, not for use: its preprocessing differentiates across file
joins, smooths with a shift of half a sample, and has settings made by hand. Use
``dart_lab.identification.submodels`` to identify a car.
"""

from __future__ import annotations

from .folders import FOLDERS, JoinedRows, read_folder
from .run import PAPER_SUBMODELS, AsPaper, as_paper, fit_as_paper

__all__ = ["FOLDERS", "PAPER_SUBMODELS", "AsPaper", "JoinedRows", "as_paper", "fit_as_paper",
           "read_folder"]
