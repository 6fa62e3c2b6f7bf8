"""Correction of stamps when the clock of a source of poses is set while it sends; no I/O.

Arrival minus stamp is the offset of the two clocks plus the delay of the pose, which is never
negative. Let base be the smallest offset of the last seconds.

1. offset < base - step: the clock was set forward. Shift the stamps at once.
2. offset > base + step: the clock was set back, or the network is slow. Only a clock that was set
   back repeats stamps, and the offsets of a slow network vary. Until this is decided, poses are
   withheld: as delayed poses they would move the car back to an earlier position.
3. Otherwise the pose is normal and its offset is added to the window.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from dart_hal.core.types import ExternalPose

# s: a smaller delay does not matter to the pose filter, and two quartz clocks drift apart by less
# in a minute.
MIN_CLOCK_STEP = 0.05
# s of arrivals; the smallest offset among them is that of the clocks.
OFFSET_WINDOW = 2.0
# s for which a larger offset has to last after stamps that went back.
CONFIRM_TIME = 0.3
# s after stamps that did not go back: the clock was set while the car was hidden.
CONFIRM_TIME_HIDDEN = 3.0
# s: spread of the offsets after the clock was set; those of a congested network vary more.
MAX_OFFSET_SPREAD = 0.02


class ClockStepFilter:
    """Corrects the stamps of one source. ``steps``: how often its clock was set."""

    def __init__(self) -> None:
        self.steps = 0
        self._shift = 0.0
        self._highest = float("-inf")
        self._offsets: deque[tuple[float, float]] = deque()
        self._late_offsets: list[tuple[float, float]] = []
        self._back = self._congested = False

    def correct(self, pose: ExternalPose) -> ExternalPose | None:
        """Return the pose with its stamp by the clock's first setting; None: withheld."""
        offset = pose.arrival - pose.stamp - self._shift
        base = min((o for _, o in self._offsets), default=offset)
        if offset > base + MIN_CLOCK_STEP:
            if not self._late_offsets:
                self._back = pose.stamp <= self._highest
            if not self._congested:
                self._late_offsets.append((pose.arrival, offset))
            if self._congested or not self._stays():
                return self._shift_stamp(pose) if self._congested else None
            self._apply_step(min(o for _, o in self._late_offsets) - base)
        elif offset < base - MIN_CLOCK_STEP:
            self._apply_step(offset - base)
        self._late_offsets.clear()
        self._congested = False
        self._highest = pose.stamp
        self._offsets.append((pose.arrival, pose.arrival - pose.stamp - self._shift))
        while self._offsets[0][0] < pose.arrival - OFFSET_WINDOW:
            self._offsets.popleft()
        return self._shift_stamp(pose)

    def _stays(self) -> bool:
        """Return whether the withheld offsets are those of a clock that was set back."""
        end = self._late_offsets[-1][0]
        offsets = [o for _, o in self._late_offsets]
        self._congested = not self._back and max(offsets) - min(offsets) > MAX_OFFSET_SPREAD
        wait = CONFIRM_TIME if self._back else CONFIRM_TIME_HIDDEN
        return not self._congested and len(offsets) > 2 and end - self._late_offsets[0][0] >= wait

    def _shift_stamp(self, pose: ExternalPose) -> ExternalPose:
        return replace(pose, stamp=max(pose.stamp + self._shift, 0.0)) if self._shift else pose

    def _apply_step(self, step: float) -> None:
        """Shift all later stamps by ``step`` [s]."""
        self._shift += step
        self.steps += 1
