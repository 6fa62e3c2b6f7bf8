"""Ages of commands from which fits start, and how strongly the age changes the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from .residuals import Evidence, Residuals
from .space import MessageTiming, max_age_spread

# (mean age, spread) of commands before their message [s], from which fits start.
START_AGES = tuple((a, share * max_age_spread(a)) for a in (0.0, 0.02, 0.04, 0.06, 0.08)
                   for share in ((0.0, 0.8) if a else (0.0,)))
# Shifts of the command age [s] for its sensitivity. Several, because the response to a step of a
# command changes only with a shift across the start of a window or a read-out.
AGE_STEPS = (-0.025, -0.008, 0.008, 0.025)
# The same where commands have a stamp and wait less than one PWM frame: nearly half a frame to each
# side.
FRAME_AGE_STEPS = (-0.4 * PWM_FRAME, 0.4 * PWM_FRAME)


def age_sensitivity(evidence: Evidence, p: Vehicle, timing: MessageTiming, reference: Residuals,
                    min_spread_s: float) -> FloatArray | None:
    """Compute the largest change of the motion residuals (n, c) per second of command age.

        max over shifts d of |e(age + d) - e(age)| / |d|

    reference: residuals of p at ``timing``. Returns None if all commands have the same age: there
    are no stamps, and the age can spread by less than ``min_spread_s`` [s].
    """
    stamped = evidence.commands_stamped
    age = timing.command_age
    if not stamped and max_age_spread(age) < min_spread_s:
        return None
    shifts = FRAME_AGE_STEPS if stamped else AGE_STEPS
    changes = [np.abs(evidence.residuals(p, replace(timing, command_age=age + d)).motion
                      - reference.motion) / abs(d) for d in shifts]
    return np.asarray(np.max(changes, axis=0))
