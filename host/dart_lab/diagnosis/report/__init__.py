"""The report of a diagnosis: one self-contained HTML page, and its sentences."""

from __future__ import annotations

from .explain import describe_cause, describe_claim
from .page import page, write_page
from .patterns import describe_pattern
from .summary import headline
from .words import removes

__all__ = ["describe_cause", "describe_claim", "describe_pattern", "headline", "page", "removes",
           "write_page"]
