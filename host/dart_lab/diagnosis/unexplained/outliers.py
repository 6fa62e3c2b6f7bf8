"""Find moments with exceptionally large errors, independent of any variable.

A gust, a lost command or a lifted wheel occurs at random times with either sign. It has no mean
along any variable, so it is neither a cause nor structure, and it increases the noise estimate. But
the errors have long tails. With x the error of a channel after 0.5 s about its median, a the
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
from dart_lab.identification.evidence.ages import age_sensitivity
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import replace_diverged
from dart_lab.identification.evidence.policy import NoisePolicy
from dart_lab.identification.evidence.residuals import MOTION, Evidence
from dart_lab.identification.evidence.space import MAX_COMMAND_AGE, MessageTiming

from ..error_summaries import ErrorMoment, Outliers

# Of 48 simulated minutes of six kinds of driving without a cause, one is above one of these limits;
# the largest of the others are 1.31, 1.85 and 1.55. Of 24 fresh ones another is above.
MAX_TAIL_RATIO = MappingProxyType({"v_x": 1.5, "v_y": 1.9, "omega": 1.6})
# With fewer windows the median error is uncertain by more than 15 %.
MIN_WINDOWS = 40
# Samples after the start of a window: errors have grown, and the moment is still close.
PREDICTION_SAMPLES = 50
# Robust standard deviations above which a window is listed: 1 in 16,000 normal errors.
MIN_MOMENT_RATIO = 4.0
# Listed moments of a channel.
MAX_MOMENTS = 5
# s between two listed moments: neighbours of the largest error are the same event.
MIN_MOMENT_DISTANCE_S = 1.0


def find_outliers(evidence: Evidence, vehicle: Vehicle, timing: MessageTiming, policy: NoisePolicy
                  ) -> tuple[Outliers, ...]:
    """Find the channels of the motion with long tails, and their largest errors.

    Returns nothing without motion capture: the initial state of a window then has errors of its
    own.
    """
    residuals = evidence.residuals(vehicle, timing)
    if not evidence.has_mocap or len(residuals.motion) < MIN_WINDOWS:
        return ()
    changes = age_sensitivity(evidence, vehicle, timing, residuals, policy.age_s)
    # Largest error of a command age: uniform waits within half a PWM frame, or up to a message.
    age = np.sqrt(3.0) * PWM_WAIT_STD if evidence.commands_stamped else 0.5 * MAX_COMMAND_AGE
    found = []
    for i, channel in enumerate(MOTION):
        column = READ_OUTS.index(PREDICTION_SAMPLES) * len(MOTION) + i
        x = replace_diverged(residuals.motion[:, column])
        x = x - np.median(x)
        size = MAD_TO_SIGMA * float(np.median(np.abs(x))) + 1e-9
        max_change = np.zeros(len(x)) if changes is None else age * np.abs(changes[:, column])
        excess = np.maximum(np.abs(x) - max_change, 0.0)
        ratio = float(np.sqrt(np.mean(excess**2))) / size
        if ratio > MAX_TAIL_RATIO[channel]:
            ratios = excess / size
            worst = [w for w in np.argsort(-ratios).tolist() if ratios[w] >= MIN_MOMENT_RATIO]
            found.append(Outliers(channel, ratio, list_moments(evidence, PREDICTION_SAMPLES, worst,
                                                               x, ratios)))
    return tuple(found)


def list_moments(evidence: Evidence, prediction_samples: int, windows: Sequence[int],
                 error: FloatArray, ratios: FloatArray) -> tuple[ErrorMoment, ...]:
    """List the first moments of some windows, at most MAX_MOMENTS, without near neighbours.

    prediction_samples: samples after the start of a window. windows: most important first. error
    (n,), ratios (n,): as in ``ErrorMoment``, of all windows.
    """
    starts = np.concatenate([d.starts for d in evidence.drives])
    out: list[ErrorMoment] = []
    taken: list[tuple[int, int]] = []
    for w in windows:
        if len(out) == MAX_MOMENTS:
            break
        drive = int(evidence.motion_drive[w])
        sample = int(starts[w]) + prediction_samples
        if any(drive == other and abs(sample - previous) * SAMPLE < MIN_MOMENT_DISTANCE_S for other,
               previous in taken):
            continue
        taken.append((drive, sample))
        g = evidence.drives[drive].grid
        out.append(ErrorMoment(evidence.drives[drive].recording.name, sample * SAMPLE,
                               float(error[w]), float(ratios[w]), float(g.v_x[sample]),
                               float(g.throttle[sample]), float(g.steering[sample])))
    return tuple(out)
