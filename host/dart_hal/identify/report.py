"""What became of one file in an identification: rows used, rows left out, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class FileReport:
    """used, dropped: samples in and left out of the fits; why: one sentence each.

    sha256 of the file's bytes, "" where the file was not read.
    """

    used: int
    dropped: int = 0
    why: tuple[str, ...] = ()
    sha256: str = ""

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal identify --json`` prints it."""
        return {"used": self.used, "dropped": self.dropped, "why": list(self.why)}
