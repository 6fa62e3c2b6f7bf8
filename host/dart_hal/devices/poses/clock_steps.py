"""Stamps of a source whose clock was set while it told poses: as if it had not been; no I/O.

Arrival minus stamp is the offset of the two clocks plus what the pose was late.
Nothing arrives early: an offset that falls at once is a clock that was set forward.
One that rises and stays is a clock that was set back, or a slow network; only
the first makes stamps repeat, and a network is not steady. Until it is plain the
poses are held back, for taken as late ones they would put the car where it was before.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from dart_hal.core.types import ExternalPose

STEP = 0.05
"""s; a pose that is later is no news to the tracker, and quartzes part by less in a minute."""
REMEMBERED = 2.0
"""s of arrivals whose most prompt one tells the offset."""
CONFIRMED, UNSEEN = 0.3, 3.0
"""s for which an offset has to stay: after stamps that went back; after ones that did not,
as the clock was set while the car was hidden."""
STEADY = 0.02
"""s by which offsets of a set clock differ; those of a network that is congested by more."""


class ClockSteps:
    """One per source. ``steps``: how often its clock was set."""

    def __init__(self) -> None:
        self.steps = 0
        self._shift = 0.0
        self._highest = float("-inf")
        self._prompt: deque[tuple[float, float]] = deque()
        self._held: list[tuple[float, float]] = []
        self._back = self._congested = False

    def through(self, pose: ExternalPose) -> ExternalPose | None:
        """The pose with a stamp of the clock as it was at first; None: held back."""
        offset = pose.arrival - pose.stamp - self._shift
        base = min((o for _, o in self._prompt), default=offset)
        if offset > base + STEP:
            if not self._held:
                self._back = pose.stamp <= self._highest
            if not self._congested:
                self._held.append((pose.arrival, offset))
            if self._congested or not self._stays():
                return self._shifted(pose) if self._congested else None
            self._step(min(o for _, o in self._held) - base)
        elif offset < base - STEP:
            self._step(offset - base)
        self._held.clear()
        self._congested = False
        self._highest = pose.stamp
        self._prompt.append((pose.arrival, pose.arrival - pose.stamp - self._shift))
        while self._prompt[0][0] < pose.arrival - REMEMBERED:
            self._prompt.popleft()
        return self._shifted(pose)

    def _stays(self) -> bool:
        """Whether the poses that are held tell of a clock that was set back."""
        end = self._held[-1][0]
        offsets = [o for _, o in self._held]
        self._congested = not self._back and max(offsets) - min(offsets) > STEADY
        wait = CONFIRMED if self._back else UNSEEN
        return not self._congested and len(offsets) > 2 and end - self._held[0][0] >= wait

    def _shifted(self, pose: ExternalPose) -> ExternalPose:
        return replace(pose, stamp=max(pose.stamp + self._shift, 0.0)) if self._shift else pose

    def _step(self, by: float) -> None:
        self._shift += by
        self.steps += 1
