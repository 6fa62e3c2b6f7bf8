"""Find steering commands that acted later than their log allows: lost messages, a stalled link.

A log gives each command an age of 0 to MAX_COMMAND_AGE, or none where commands are synchronous with
their messages. A car that loses a message keeps the previous command, so the change acts later than
it was logged. The errors of v_y and yaw rate 0.25 s ahead are fitted twice, see ``fit_ages``:

1. with the ages that the log allows,
2. with commands that act up to MAX_EXTRA_DELAY_S later as well.

The second fit gains in log likelihood where windows after a change of a command are explained by
the previous command. A gust gains nothing: no age of a command explains it. The throttle is not
judged: v_x follows it so slowly that 0.1 s has little effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.effect import Stateful
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import replace_diverged
from dart_lab.identification.evidence.residuals import MOTION, Evidence
from dart_lab.identification.evidence.space import MAX_COMMAND_AGE, MessageTiming

from .error_summaries import LateCommands
from .gains import RecordingSet
from .noise_floor import MIN_WINDOWS
from .parameters.unseen import AGE_TOLERANCE_S
from .unexplained.command_ages import MIN_LOG_RATIO, fit_ages, interpolate_ages
from .unexplained.driven import remove_driven
from .unexplained.outliers import MAX_MOMENTS, list_moments

# Windows start every 25 samples, so each change of a command is in one; further ahead the
# disturbance grows.
LATE_READ_OUT = READ_OUTS.index(25)
# A lost message delays a change until the next one, 0.1 s, and AGE_TOLERANCE_S.
MAX_EXTRA_DELAY_S = 0.11
AGE_GRID_STEP_S = 0.010  # s between ages at which windows are predicted, interpolated in between
# Late commands make the data e^5 = 150 times as probable. Of 62 simulated drives of six kinds that
# hide nothing (60 s and 40 s) the largest gain is 4.6.
MIN_GAIN = 5.0  # log likelihood
MIN_LISTED_PROBABILITY = 0.9  # of a late command in a window
# Columns of the residuals that follow the steering at once; the last is the yaw rate.
LATERAL = [LATE_READ_OUT * len(MOTION) + MOTION.index(name) for name in ("v_y", "omega")]


@dataclass(frozen=True, slots=True)
class _AgeComparison:
    """Comparison of ages in the windows of one set of recordings.

    gain: of the log likelihood; late (n,): probability that a command acted too late; delay (n,):
    expected extra delay [s]; informative (n,): whether the error depends on the age; error (n,): of
    the yaw rate; std: its standard deviation.
    """

    gain: float
    late: FloatArray
    delay: FloatArray
    informative: BoolArray
    error: FloatArray
    std: float

    @property
    def clear_windows(self) -> list[int]:
        """Windows in which a command very probably acted too late, the largest error first."""
        return [w for w in np.argsort(-np.abs(self.error)).tolist()
                if self.late[w] >= MIN_LISTED_PROBABILITY]


def find_late_commands(sets: Sequence[RecordingSet], vehicle: Vehicle,
                       timings: Sequence[MessageTiming]) -> LateCommands | None:
    """Find commands that acted later than the logs of these recordings allow.

    timings: that suit each set. Returns None if there are none, without motion capture, for runs,
    whose commands are stamped at their pulses, and with an effect that delays changes of the
    steering: the play or rate limit of a car differs a little from that of the catalogue, and acts
    later at some changes.
    """
    if any(isinstance(signal, Stateful) for channel in ("steering", "angle")
           for _, signal in signals(vehicle, channel)):
        return None
    evidences = [part.evaluation_windows() for part in sets]
    found = []
    for part, evidence, timing in zip(sets, evidences, timings, strict=True):
        if (not part.evidence.has_mocap or part.evidence.commands_stamped
                or len(evidence.motion_drive) < MIN_WINDOWS):
            return None
        found.append(_compare_windows(evidence, vehicle, timing))
    gain = sum(one.gain for one in found)
    if gain < MIN_GAIN:
        return None
    late = np.concatenate([one.late for one in found])
    informative = np.concatenate([one.informative for one in found])
    delay = np.concatenate([one.delay for one in found])
    moments = [m for evidence, one in zip(evidences, found, strict=True)
               for m in list_moments(evidence, READ_OUTS[LATE_READ_OUT], one.clear_windows,
                                     one.error, np.abs(one.error) / one.std)]
    return LateCommands(float(late[informative].mean()), float(np.average(delay, weights=late)),
                        gain, tuple(moments[:MAX_MOMENTS]))


def compare_ages(by_age: FloatArray, ages: FloatArray, youngest: float, oldest: float
                 ) -> tuple[float, FloatArray]:
    """Return the gain in log likelihood by ages below ``youngest``, and age probabilities.

    by_age (k, n, c): errors of windows if all commands have each of the ages (k,) [s]. youngest,
    oldest: ages that the log allows. The probabilities (k, n) are of the fit that allows all.
    """
    allowed = (ages >= youngest) & (ages <= oldest)
    later = ages <= oldest
    fit = fit_ages(by_age[later])
    posterior = np.zeros((len(ages), by_age.shape[1]))
    posterior[later] = fit.posterior
    return fit.log_likelihood - fit_ages(by_age[allowed]).log_likelihood, posterior


def _compare_windows(evidence: Evidence, vehicle: Vehicle, timing: MessageTiming) -> _AgeComparison:
    """Compare the ages in the windows of one set of recordings."""
    def compute_errors(age: float) -> FloatArray:
        other = replace(timing, command_age=age, age_spread=0.0)
        return replace_diverged(evidence.residuals(vehicle, other).motion[:, LATERAL])

    steps = round((MAX_EXTRA_DELAY_S + MAX_COMMAND_AGE + AGE_TOLERANCE_S) / AGE_GRID_STEP_S)
    coarse = np.asarray(-MAX_EXTRA_DELAY_S + AGE_GRID_STEP_S * np.arange(steps + 1),
                        dtype=np.float64)
    usual = compute_errors(timing.command_age)
    rest = remove_driven(evidence, vehicle, usual, READ_OUTS[LATE_READ_OUT])
    rest = rest - np.median(rest, axis=0)
    fault = usual - rest
    by_age = interpolate_ages(np.stack([compute_errors(a) for a in coarse])) - fault
    ages = interpolate_ages(coarse)
    synchronous = timing.command_age <= AGE_TOLERANCE_S
    youngest = -AGE_TOLERANCE_S - 1e-9
    oldest = AGE_TOLERANCE_S + 1e-9 if synchronous else MAX_COMMAND_AGE + AGE_TOLERANCE_S + 1e-9
    gain, posterior = compare_ages(by_age, ages, youngest, oldest)
    late = posterior[ages < youngest].sum(axis=0)
    shift = np.maximum(timing.command_age - ages, 0.0)[:, None]
    delay = np.sum(posterior * shift * (ages < youngest)[:, None], axis=0) / np.maximum(late, 1e-12)
    std = fit_ages(rest[None]).std
    informative = np.any(np.ptp(by_age / std, axis=0) > np.sqrt(2.0 * MIN_LOG_RATIO), axis=1)
    return _AgeComparison(gain, late, delay, informative, usual[:, -1], float(std[-1]))
