"""Diagnosis: what a model gets wrong on recordings, its physical cause, and the extended model.

``run.diagnose`` calls the packages in this order: ``evidence`` makes residuals and their noise of
recordings; ``search`` accepts or refuses effects of the catalogue, round by round; ``grade`` says
how probable an effect is and whether its size is constant; ``parameters`` says which numbers of the
model were wrong; ``unexplained`` looks for structure that is left. ``conclude`` draws the verdict,
``gains`` measures the errors on test recordings, ``report`` writes the page, ``suggest`` finds the
next drive. Every condition of an accepted effect is in ``gates``, every threshold in ``policy``.
"""

from __future__ import annotations

from .result import Diagnosis
from .run import diagnose

__all__ = ["Diagnosis", "diagnose"]
