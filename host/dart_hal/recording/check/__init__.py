"""What is in a recording, what is wrong with it, and what it is good for. Pure: no printing."""

from __future__ import annotations

from .facts import Facts, MocapFacts, facts
from .findings import Finding, findings
from .kinds import DONE
from .report import Check, Summary, check, folder_of, stem_of, summary
from .uses import PURPOSES, Use, uses

__all__ = ["DONE", "PURPOSES", "Check", "Facts", "Finding", "MocapFacts", "Summary", "Use",
           "check", "facts", "findings", "folder_of", "stem_of", "summary", "uses"]
