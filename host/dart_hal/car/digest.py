"""A recorded run in a few numbers: how far and fast, how the loop and the link held."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.car.car import Car
from dart_hal.core.types import FloatArray
from dart_hal.recording.run import RunReader


@dataclass(frozen=True, slots=True)
class Digest:
    """Of one run: times in s, distance in m, speed in m/s.

    period: p50, p99 and max between commands of the program, NaN where it gave none; doubts:
    seconds with each doubt; firmware: version and board of HELLO; files: texts of the car's files.
    """

    path: str
    car: str
    when: str
    duration: float
    distance: float
    fastest: float
    frames: int
    lost: int
    damaged: int
    period: tuple[float, float, float]
    doubts: Mapping[str, float]
    firmware: str
    files: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """Without the files."""
        out = asdict(self)
        del out["files"]
        return out


def digest(path: Path) -> Digest:
    """Read a run. Errors: RecordingError for a file that is none, OSError."""
    reader = RunReader(path)
    asked = np.array([c.t for c in reader.commands()])
    doubts: Counter[str] = Counter()
    distance, fastest, first, last, frames, lost = 0.0, 0.0, None, None, 0, 0
    with Car.open(f"replay://{path}") as car:
        for state in car.states():
            if last is None:
                first = state.t
            else:
                doubts.update(dict.fromkeys(state.health.doubts, state.t - last))
                distance += abs(state.speed) * (state.t - last)
            last, frames, lost = state.t, frames + 1, state.health.lost
            fastest = max(fastest, abs(state.speed))
        damaged, hello = car.timing.damaged, car.hello
    firmware = ".".join(map(str, hello.version)) + (" (mock)" if hello.mock else "")
    when = datetime.fromtimestamp(path.stat().st_mtime, timezone.utc)
    return Digest(path.name, reader.meta.get("car", ""), when.isoformat(timespec="minutes"),
                  (last or 0.0) - (first or 0.0), distance, fastest, frames, lost, damaged,
                  _period(asked), dict(doubts), firmware, reader.files)


def _period(asked: FloatArray) -> tuple[float, float, float]:
    if len(asked) < 3:
        return float("nan"), float("nan"), float("nan")
    between = np.diff(asked)
    return (float(np.median(between)), float(np.quantile(between, 0.99)), float(between.max()))
