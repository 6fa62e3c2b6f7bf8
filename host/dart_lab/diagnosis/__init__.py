"""Diagnosis: what a model gets wrong on recordings, its physical cause, and the extended model.

``run.diagnose`` makes residuals of the recordings (``evidence``), finds candidates among the
effects of the catalogue, round by round (``search``), and calls ``conclude``. That calls, in order:

1. ``unexplained``: structure of the residuals; candidates that leave it as it was are withdrawn.
2. ``grade``: how probable each candidate is, and whether its size is constant. It is then accepted
   or rejected.
3. ``final_fit``: the numbers that are reported.
4. ``gains``: the errors on the test recordings.
5. ``parameters``: which numbers of the model were wrong.
6. ``unexplained`` and others: what is left. Then it draws the verdict.

``report`` writes the page, ``suggest`` finds the next drive. Every condition of an accepted effect
is in ``gates``. The thresholds that studies vary are in ``policy``, the others are constants of the
modules that use them.
"""

from __future__ import annotations

from .result import Diagnosis
from .run import diagnose

__all__ = ["Diagnosis", "diagnose"]
