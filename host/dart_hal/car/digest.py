"""Summary of a recorded run: distance, speed, loop period, losses, doubts."""

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
    """Summary of one run; times in s, distance in m, speed in m/s.

    period: median, 99 % quantile and maximum between commands of the program, NaN without commands.
    doubts: time with each doubt. firmware: version of HELLO. files: texts of the car's files.
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
        """Return the fields as JSON, without the files."""
        out = asdict(self)
        del out["files"]
        return out


def digest(path: Path) -> Digest:
    """Summarise a run. Raises RecordingError for a file that is not a run, OSError."""
    reader = RunReader(path)
    times = np.array([c.t for c in reader.commands()])
    doubts: Counter[str] = Counter()
    distance = 0.0
    fastest = 0.0
    first = None
    last = None
    frames = 0
    lost = 0
    with Car.open(f"replay://{path}") as car:
        for state in car.states():
            if last is None:
                first = state.t
            else:
                doubts.update(dict.fromkeys(state.health.doubts, state.t - last))
                distance += abs(state.speed) * (state.t - last)
            last = state.t
            frames = frames + 1
            lost = state.health.lost
            fastest = max(fastest, abs(state.speed))
        damaged = car.timing.damaged
        hello = car.hello
    firmware = ".".join(map(str, hello.version)) + (" (mock)" if hello.mock else "")
    when = datetime.fromtimestamp(path.stat().st_mtime, timezone.utc)
    return Digest(path.name, reader.meta.get("car", ""), when.isoformat(timespec="minutes"),
                  (last or 0.0) - (first or 0.0), distance, fastest, frames, lost, damaged,
                  _command_periods(times), dict(doubts), firmware, reader.files)


def _command_periods(times: FloatArray) -> tuple[float, float, float]:
    """Return median, 99 % quantile and maximum [s] between command times (n,); NaN for n < 3."""
    if len(times) < 3:
        return float("nan"), float("nan"), float("nan")
    between = np.diff(times)
    return (float(np.median(between)), float(np.quantile(between, 0.99)), float(between.max()))
