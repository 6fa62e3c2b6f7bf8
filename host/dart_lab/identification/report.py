"""What became of each file in an identification, and the published values beside a fit."""

from __future__ import annotations

from collections.abc import Mapping
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


@dataclass(frozen=True, slots=True)
class Published:
    """The paper's own values: by name, and the rmse they leave on the same rows, if known."""

    values: Mapping[str, float]
    rmse: float | None = None
