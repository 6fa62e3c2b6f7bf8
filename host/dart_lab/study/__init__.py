"""A guided study of a car: check, identifiability, fit, validation, diagnosis, next drive.

Each stage writes its result into the folder of the study, and can be repeated alone.
"""

from __future__ import annotations

from .page import write_study_page
from .stages import STAGES, StageResult, Study, load_results, run_stage, split_recordings

__all__ = ["STAGES", "StageResult", "Study", "load_results", "run_stage", "split_recordings",
           "write_study_page"]
