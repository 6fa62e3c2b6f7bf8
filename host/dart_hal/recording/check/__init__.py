"""Check of recordings: content, findings and uses."""

from __future__ import annotations

from .facts import MocapFacts, RecordingFacts, facts
from .findings import Finding, findings
from .kinds import DONE
from .report import CheckSummary, RecordingCheck, check, folder_of, stem_of, summary
from .uses import PURPOSES, Use, uses

__all__ = [
           "DONE",
           "PURPOSES",
           "CheckSummary",
           "Finding",
           "MocapFacts",
           "RecordingCheck",
           "RecordingFacts",
           "Use",
           "check",
           "facts",
           "findings",
           "folder_of",
           "stem_of",
           "summary",
           "uses",
]
