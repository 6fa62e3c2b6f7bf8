"""The published recordings of DART: where they are kept, and how they are brought there."""

from __future__ import annotations

from .bring import FetchOutcome, fetch
from .folder import data_folder, find
from .published import load

__all__ = ["FetchOutcome", "data_folder", "fetch", "find", "load"]
