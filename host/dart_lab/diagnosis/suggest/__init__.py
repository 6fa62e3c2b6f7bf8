"""Suggestions of the next drive: what distinguishes causes that these data cannot distinguish."""

from .choose import suggest
from .result import DrivePrediction, Pair, Suggestion, TriedDrive
from .sharpen import ParameterDrive, suggest_parameter_drives

__all__ = ["DrivePrediction", "Pair", "ParameterDrive", "Suggestion", "TriedDrive", "suggest",
           "suggest_parameter_drives"]
