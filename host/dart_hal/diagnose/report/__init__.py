"""The report of a diagnosis: one self-contained HTML page, and its sentences."""

from __future__ import annotations

from .explain import describe_cause, describe_claim
from .page import page, write_page
from .words import removes, structure, verdict

__all__ = ["describe_cause", "describe_claim", "page", "removes", "structure", "verdict",
           "write_page"]
