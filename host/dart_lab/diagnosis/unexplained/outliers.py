"""Find moments at which errors are far larger than otherwise, whenever they come.

A gust, a lost command or a wheel that lifts comes at times of its own and with either sign. It has
no mean along any variable, so it is neither a cause nor structure, and it widens what is taken for
noise. But it leaves long tails. With x the error of a channel 0.5 s ahead about its median, a the
largest change by the unknown age of a command, and m the robust standard deviation of x:

    ratio = rms(max(|x| - a, 0)) / m

which is 1 for normal errors and known ages.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from dart_hal.core.timing import PWM_WAIT_STD, SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA
from dart_hal.vehicle.parameters import Vehicle

from ..error_summaries import Moment, Outliers
from ..evidence.ages import age_sensitivity
from ..evidence.drive import READ_OUTS
from ..evidence.noise import replace_diverged
from ..evidence.residuals import MOTION, Evidence
from ..evidence.space import MAX_COMMAND_AGE, MessageTiming
from ..policy import NoisePolicy

MOST_RATIO = MappingProxyType({"v_x": 1.5, "v_y": 1.9, "omega": 1.6})
"""Of 48 simulated minutes of six kinds of driving that hide nothing, one is above one of these;
the largest of the others are 1.31, 1.85 and 1.55. Of 24 fresh ones another is above."""
LEAST_WINDOWS = 40
"""With fewer the median size of an error is known worse than to 15 %."""
AHEAD = 50
"""Samples after the start of a window: errors have grown, and the moment is still near."""
FAR = 4.0
"""Robust standard deviations beyond which a window is listed: 1 in 16,000 normal ones."""
MOST_MOMENTS = 5
"""Listed moments of a channel."""
APART = 1.0
"""s between two moments; neighbours of the worst one are the same event."""


def find_outliers(evidence: Evidence, vehicle: Vehicle, timing: MessageTiming, policy: NoisePolicy
                  ) -> tuple[Outliers, ...]:
    """Return the channels of the motion with long tails, with their worst moments.

    Empty without motion capture: there the state at the start of a window has errors of its own.
    """
    residuals = evidence.residuals(vehicle, timing)
    if not evidence.has_mocap or len(residuals.motion) < LEAST_WINDOWS:
        return ()
    changes = age_sensitivity(evidence, vehicle, timing, residuals, policy.age_s)
    # uniform waits of half a PWM frame to either side, or ages up to the next message
    age = np.sqrt(3.0) * PWM_WAIT_STD if evidence.commands_stamped else 0.5 * MAX_COMMAND_AGE
    found = []
    for i, channel in enumerate(MOTION):
        column = READ_OUTS.index(AHEAD) * len(MOTION) + i
        x = replace_diverged(residuals.motion[:, column])
        x = x - np.median(x)
        size = MAD_TO_SIGMA * float(np.median(np.abs(x))) + 1e-9
        reach = np.zeros(len(x)) if changes is None else age * np.abs(changes[:, column])
        beyond = np.maximum(np.abs(x) - reach, 0.0)
        ratio = float(np.sqrt(np.mean(beyond**2))) / size
        if ratio > MOST_RATIO[channel]:
            times = beyond / size
            worst = [w for w in np.argsort(-times).tolist() if times[w] >= FAR]
            found.append(Outliers(channel, ratio, list_moments(evidence, AHEAD, worst, x, times)))
    return tuple(found)


def list_moments(evidence: Evidence, ahead: int, windows: Sequence[int], error: FloatArray,
                 times: FloatArray) -> tuple[Moment, ...]:
    """List the first moments of some windows that are APART, MOST_MOMENTS at most.

    ahead: samples after the start of a window; windows: the most important one first; error (n,),
    times (n,): as in ``Moment``, of all windows.
    """
    starts = np.concatenate([d.starts for d in evidence.drives])
    out: list[Moment] = []
    taken: list[tuple[int, int]] = []
    for w in windows:
        if len(out) == MOST_MOMENTS:
            break
        drive, at = int(evidence.motion_drive[w]), int(starts[w]) + ahead
        if any(drive == other and abs(at - then) * SAMPLE < APART for other, then in taken):
            continue
        taken.append((drive, at))
        g = evidence.drives[drive].grid
        out.append(Moment(evidence.drives[drive].recording.name, at * SAMPLE, float(error[w]),
                          float(times[w]), float(g.v_x[at]), float(g.throttle[at]),
                          float(g.steering[at])))
    return tuple(out)
