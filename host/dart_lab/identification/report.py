"""Use of each file in an identification, and the published values to compare a fit with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class FileReport:
    """Samples of one file that the fits used and dropped, and why (one sentence each).

    sha256: of the file's bytes, "" if the file was not read.
    """

    used: int
    dropped: int = 0
    why: tuple[str, ...] = ()
    sha256: str = ""

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal identify --json`` prints it."""
        return {"used": self.used, "dropped": self.dropped, "why": list(self.why)}


@dataclass(frozen=True, slots=True)
class Published:
    """Published values by name, and their rmse on the rows of the fit, if known."""

    values: Mapping[str, float]
    rmse: float | None = None
