"""How old commands may be, and what their age does to the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from .residuals import Evidence, Residuals
from .space import Timing, widest

AGES = tuple((a, share * widest(a)) for a in (0.0, 0.02, 0.04, 0.06, 0.08)
             for share in ((0.0, 0.8) if a else (0.0,)))
"""s, of commands before their message, and how far they spread around it: where fits begin."""
OLDER = (-0.025, -0.008, 0.008, 0.025)
"""s, by which commands are moved to see what their age does; a step does it at one instant."""
WITHIN_FRAME = (-0.4 * PWM_FRAME, 0.4 * PWM_FRAME)
"""s, the same where commands wait for a frame: nearly as far as that goes."""


def older(evidence: Evidence, p: Vehicle, timing: Timing, seen: Residuals,
          known_s: float) -> FloatArray | None:
    """By how much the age of a command moves the motion at most (n, c) [1/s].

    seen: residuals of p at that timing. None where no command has an age of its own: those that
    have no stamps, and a spread of less than known_s [s].
    """
    stamped, age = evidence.commands_stamped, timing.command_age
    if not stamped and widest(age) < known_s:
        return None
    moved = [np.abs(evidence.residuals(p, replace(timing, command_age=age + d)).motion
                    - seen.motion) / abs(d) for d in (WITHIN_FRAME if stamped else OLDER)]
    return np.asarray(np.max(moved, axis=0))
