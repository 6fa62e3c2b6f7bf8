"""Room of the diagnosis: residuals, named causes, extended models."""

from __future__ import annotations

from .result import Diagnosis
from .run import diagnose

__all__ = ["Diagnosis", "diagnose"]
