"""Age limit of human inputs: a gamepad, a keyboard, the hand at a live page, a ROS publisher.

A program that reads an input in its loop always finds a value: the last one. That value says
nothing about the device, which may be out of radio range or behind a frozen connection. So each
input keeps the time of the last report of its *source*. Beyond the limit the throttle is neutral,
and it stays neutral until the operator has released the control and pressed it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

# Time from a decision to the end of the last driving pulse at the ESC: one State (10 ms), one PWM
# frame (20 ms), one pulse (2 ms), and the same again for a slow loop.
REACTION_S = 0.05
# Limit for a source that reports periodically: the ESC is neutral 0.5 s after the last report.
MAX_REPORT_AGE_S = 0.5 - REACTION_S
# Limit for a source that reports changes only: the ESC is neutral 1 s after the last change. A
# stick that a hand holds jitters, so its reports come much more often.
MAX_UNCHANGED_S = 1.0 - REACTION_S
# Longest pause of the reading program. What it finds after a longer one has an unknown age; a
# command to the car has run out by then too.
MAX_READ_GAP_S = 0.2


@dataclass(slots=True)
class InputAge:
    """Time since the last report of one source; ``limit`` [s]."""

    limit: float
    reported_at: float = -inf

    def report(self, now: float) -> None:
        """Record that the source has reported at ``now`` [s]."""
        self.reported_at = now

    def is_over(self, now: float) -> bool:
        """Whether the last report is older than the limit at ``now`` [s]."""
        return now - self.reported_at > self.limit
