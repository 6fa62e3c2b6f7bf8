"""The report of a diagnosis: one self-contained HTML page, and its sentences."""

from __future__ import annotations

from .page import page, write_page
from .words import removes, sentence, structure, verdict

__all__ = ["page", "removes", "sentence", "structure", "verdict", "write_page"]
