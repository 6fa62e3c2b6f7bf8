"""The published recordings of DART: where they are kept, and how they are brought there."""

from __future__ import annotations

from .bring import Outcome, fetch
from .folder import data_folder, find
from .manifest import Manifest, Published, from_folder, load

__all__ = ["Manifest", "Outcome", "Published", "data_folder", "fetch", "find", "from_folder",
           "load"]
