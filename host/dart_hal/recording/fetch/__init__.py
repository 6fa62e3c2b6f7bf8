"""The published recordings of DART: data folder and download."""

from __future__ import annotations

from .bring import FetchOutcome, fetch
from .folder import data_folder, find
from .published import load

__all__ = ["FetchOutcome", "data_folder", "fetch", "find", "load"]
