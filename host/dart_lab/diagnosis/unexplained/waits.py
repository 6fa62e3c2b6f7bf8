"""Remove from residuals what the unknown wait of pulses for their PWM frame explains.

In a recording with stamped commands, the time at which the wheels turn is known to a frame. Frames
can stay in phase with the messages for some time, so the waits of a minute are correlated, and
their effect depends on speed and steering rate like an unknown cause. By window

    w = argmin |y + B w|^2 + (w / s)^2        y, B: whitened residuals, and their change with age
                                              s = PWM_WAIT_STD; |w| <= half a frame
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME, PWM_WAIT_STD
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.noise import Noise
from dart_lab.identification.evidence.residuals import Evidence, Residuals
from dart_lab.identification.evidence.space import MessageTiming


def remove_frame_wait(evidence: Evidence, p: Vehicle, timing: MessageTiming,
                      noise: Noise) -> Residuals:
    """Residuals of p, with the motion corrected by one estimated wait per window.

    Unchanged if commands have no stamps of their own: their ages are fitted instead.
    """
    r = evidence.residuals(p, timing)
    if not evidence.commands_stamped or not len(r.motion):
        return r
    late, early = (evidence.residuals(p, replace(timing, command_age=timing.command_age + d))
                   .motion for d in (-PWM_WAIT_STD, PWM_WAIT_STD))
    # B: derivative of the residuals with respect to the age, by a central difference.
    older = np.nan_to_num((early - late) / (2.0 * PWM_WAIT_STD))
    y = noise.whiten(r)[0]
    b = (older * noise.age_scale) @ noise.motion.T
    wait = -np.sum(b * y, axis=1) / (np.sum(b**2, axis=1) + PWM_WAIT_STD**-2)
    wait = np.clip(wait, -0.5 * PWM_FRAME, 0.5 * PWM_FRAME)
    return replace(r, motion=r.motion + older * wait[:, None])
