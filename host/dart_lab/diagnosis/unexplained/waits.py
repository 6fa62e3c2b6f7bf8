"""Residuals without what pulses that wait for their frame may do: what is left of them tells.

Of a drive whose commands are stamped it is known to a frame when the wheels turn, and no better.
Frames may keep step with the messages for a while, so the waits of a minute have much in common,
and what they do goes with speed and steering rate as an unknown cause would. By window

    w = argmin |y + B w|^2 + (w / s)^2        y, B: whitened residuals, and their change with age
                                              s = PWM_WAIT_STD; |w| <= half a frame

"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME, PWM_WAIT_STD
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.noise import Noise
from ..evidence.residuals import Evidence, Residuals
from ..evidence.space import MessageTiming


def unwaited(evidence: Evidence, p: Vehicle, timing: MessageTiming, noise: Noise) -> Residuals:
    """Residuals of p, the motion less what one wait of its own explains of every window.

    As they are where commands have no instants of their own: there the ages are fitted.
    """
    r = evidence.residuals(p, timing)
    if not evidence.commands_stamped or not len(r.motion):
        return r
    late, early = (evidence.residuals(p, replace(timing, command_age=timing.command_age + d))
                   .motion for d in (-PWM_WAIT_STD, PWM_WAIT_STD))
    older = np.nan_to_num((early - late) / (2.0 * PWM_WAIT_STD))
    y, b = noise.whiten(r)[0], (older * noise.age_scale) @ noise.motion.T
    wait = -np.sum(b * y, axis=1) / (np.sum(b**2, axis=1) + PWM_WAIT_STD**-2)
    wait = np.clip(wait, -0.5 * PWM_FRAME, 0.5 * PWM_FRAME)
    return replace(r, motion=r.motion + older * wait[:, None])
