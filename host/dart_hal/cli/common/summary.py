"""Figures of a run: the common part of record, replay and drive."""

from __future__ import annotations

import hashlib
from pathlib import Path
from struct import Struct
from typing import Any

from dart_hal.car import Car
from dart_hal.core.types import State

# The eleven numbers of a State that enter the digest, as doubles; NaN for no yaw rate.
_NUMBERS = Struct("<11d")
_NONE = float("nan")


class RunSummary:
    """Counts the frames of a car and computes the SHA-256 of their numbers, from now on."""

    def __init__(self, car: Car) -> None:
        self._car = car
        car.on_state(self.add)
        self.frames = 0
        self.lost = 0
        self.distance = 0.0
        self.first: State | None = None
        self.last: State | None = None
        self._digest = hashlib.sha256()

    def add(self, state: State) -> None:
        """Enter one State."""
        if self.first is None or self.last is None:
            self.first = state
        else:
            self.distance += abs(state.speed) * (state.t - self.last.t)
        self.last = state
        self.frames += 1
        self.lost = state.health.lost
        applied, pose = state.applied, state.pose
        self._digest.update(_NUMBERS.pack(
            state.t, state.seq, state.speed, _NONE if state.yaw_rate is None else state.yaw_rate,
            state.ticks, pose.x, pose.y, pose.yaw, applied.steering_us, applied.throttle_us,
            state.health.t_std))

    @property
    def duration(self) -> float:
        """Car time [s] from the first to the last State."""
        return self.last.t - self.first.t if self.first and self.last else 0.0

    def as_json(self, files: dict[str, Path]) -> dict[str, Any]:
        """Return the JSON object of a run: url, files, duration, frames, lost, summary."""
        pose = self.last.pose if self.last else None
        return {
            "url": self._car.url, "files": files, "duration_s": self.duration,
            "frames": self.frames, "lost": self.lost,
            "summary": {
                "distance_m": self.distance, "states_sha256": self._digest.hexdigest(),
                "firmware": self._car.hello.as_json(), "damaged": self._car.timing.damaged,
                "pose": None if pose is None else {"x": pose.x, "y": pose.y, "yaw": pose.yaw},
            },
        }
