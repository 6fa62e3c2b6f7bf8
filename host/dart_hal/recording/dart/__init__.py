"""The DART recordings of 2024 and 2025: CSV of three schemas, and their defects."""

from __future__ import annotations

from .frames import with_marker_frames
from .grid import Grid, grid
from .marker import savgol_derivative, turning_share
from .model import RUN, AppliedCommands, BatteryVoltage, Messages, Mocap, Note, Recording, Reference
from .quantum import encoder_quantum
from .reader import read, read_all
from .reference import fit_reference, reference_for, rolling_reference

__all__ = [
           "RUN",
           "AppliedCommands",
           "BatteryVoltage",
           "Grid",
           "Messages",
           "Mocap",
           "Note",
           "Recording",
           "Reference",
           "encoder_quantum",
           "fit_reference",
           "grid",
           "read",
           "read_all",
           "reference_for",
           "rolling_reference",
           "savgol_derivative",
           "turning_share",
           "with_marker_frames",
]
