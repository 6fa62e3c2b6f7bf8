"""Find steering commands that acted later than their log allows: lost messages, a stalled link.

A log gives each command an age of 0 to MAX_COMMAND_AGE, or none where commands keep step with their
messages. A car that loses a message goes on with the command before, so the change acts later than
it was logged. The errors of v_y and yaw rate 0.25 s ahead are fitted twice, see ``fit_ages``:

1. with the ages that the log allows,
2. with commands that act up to MAX_LATENESS later as well.

The second fit gains in log likelihood where windows after a change of a command are explained by
the command before. A gust gains nothing: no age of a command explains it. The throttle is not
judged: v_x follows it so slowly that 0.1 s hardly shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.effect import Stateful
from dart_hal.vehicle.parameters import Vehicle

from .error_summaries import LateCommands
from .evidence.drive import READ_OUTS
from .evidence.noise import replace_diverged
from .evidence.residuals import MOTION, Evidence
from .evidence.space import MAX_COMMAND_AGE, MessageTiming
from .gains import Side
from .noise_floor import MIN_WINDOWS
from .parameters.unseen import BEYOND
from .policy import UnexplainedPolicy
from .unexplained.command_ages import MIN_LOG_RATIO, fit_ages, interpolate_ages
from .unexplained.driven import remove_driven
from .unexplained.outliers import MAX_MOMENTS, list_moments

AHEAD = READ_OUTS.index(25)
"""Windows start every 25 samples, so each change of a command lies in one; further ahead the
disturbance grows."""
MAX_LATENESS = 0.11
"""s; a message that is lost delays a change until the next one, 0.1 s, and BEYOND."""
LATE_STEP = 0.010
"""s between ages at which windows are predicted; errors are interpolated between them. The command
of the message before is 0.1 s older, ten of these."""
MIN_GAIN = 5.0
"""Of the log likelihood: late commands make the data 150 times as probable. Of 62 simulated drives
of six kinds of driving that hide nothing (60 s and 40 s) the largest gain is 4.6."""
LIKELY = 0.9
"""Probability from which on a window is listed."""
LATERAL = [AHEAD * len(MOTION) + MOTION.index(name) for name in ("v_y", "omega")]
"""Columns of the residuals that follow the steering at once; the last is the yaw rate."""


@dataclass(frozen=True, slots=True)
class _Found:
    """What the windows of one side show. gain: of the log likelihood; late (n,): probability that a
    command acted too late; delay (n,): how much [s]; informative (n,); error (n,): of the yaw rate;
    std: its standard deviation."""

    gain: float
    late: FloatArray
    delay: FloatArray
    informative: BoolArray
    error: FloatArray
    std: float

    @property
    def clear_windows(self) -> list[int]:
        """Windows in which a command very probably acted too late, the largest error first."""
        return [w for w in np.argsort(-np.abs(self.error)).tolist() if self.late[w] >= LIKELY]


def find_late_commands(sides: Sequence[Side], vehicle: Vehicle, timings: Sequence[MessageTiming],
                       policy: UnexplainedPolicy) -> LateCommands | None:
    """Find commands that acted later than the logs of these recordings allow.

    timings: that suit each side. None where there are none, without motion capture, in runs of our
    own, whose commands are stamped at their pulses, and with an effect that delays changes of the
    steering: the play or rate limit of a car differs a little from that of the catalogue, and acts
    later at some changes.
    """
    if any(isinstance(signal, Stateful) for channel in ("steering", "angle")
           for _, signal in signals(vehicle, channel)):
        return None
    evidences = [side.evaluation_windows() for side in sides]
    found = []
    for side, evidence, timing in zip(sides, evidences, timings, strict=True):
        if (not side.evidence.has_mocap or side.evidence.commands_stamped
                or len(evidence.motion_drive) < MIN_WINDOWS):
            return None
        found.append(_look(evidence, vehicle, timing, policy))
    gain = sum(one.gain for one in found)
    if gain < MIN_GAIN:
        return None
    late = np.concatenate([one.late for one in found])
    informative = np.concatenate([one.informative for one in found])
    delay = np.concatenate([one.delay for one in found])
    moments = [m for evidence, one in zip(evidences, found, strict=True)
               for m in list_moments(evidence, READ_OUTS[AHEAD], one.clear_windows, one.error,
                                     np.abs(one.error) / one.std)]
    return LateCommands(float(late[informative].mean()), float(np.average(delay, weights=late)),
                        gain, tuple(moments[:MAX_MOMENTS]))


def compare_ages(by_age: FloatArray, ages: FloatArray, youngest: float, oldest: float
                 ) -> tuple[float, FloatArray]:
    """Gain of the log likelihood by ages below ``youngest``, and the probability of ages by window.

    by_age (k, n, c): errors of windows if all commands have each of the ages (k,) [s]. youngest,
    oldest: ages that the log allows. The probabilities (k, n) are of the fit that allows all.
    """
    allowed = (ages >= youngest) & (ages <= oldest)
    later = ages <= oldest
    fit = fit_ages(by_age[later])
    posterior = np.zeros((len(ages), by_age.shape[1]))
    posterior[later] = fit.posterior
    return fit.log_likelihood - fit_ages(by_age[allowed]).log_likelihood, posterior


def _look(evidence: Evidence, vehicle: Vehicle, timing: MessageTiming, policy: UnexplainedPolicy
          ) -> _Found:
    """Compare the ages in the windows of one side."""
    def compare(age: float) -> FloatArray:
        at = replace(timing, command_age=age, age_spread=0.0)
        return replace_diverged(evidence.residuals(vehicle, at).motion[:, LATERAL])

    steps = round((MAX_LATENESS + MAX_COMMAND_AGE + BEYOND) / LATE_STEP)
    coarse = np.asarray(-MAX_LATENESS + LATE_STEP * np.arange(steps + 1), dtype=np.float64)
    usual = compare(timing.command_age)
    rest = remove_driven(evidence, vehicle, usual, READ_OUTS[AHEAD], policy)
    rest = rest - np.median(rest, axis=0)
    fault = usual - rest
    by_age = interpolate_ages(np.stack([compare(a) for a in coarse])) - fault
    ages = interpolate_ages(coarse)
    in_step = timing.command_age <= BEYOND
    youngest = -BEYOND - 1e-9
    oldest = BEYOND + 1e-9 if in_step else MAX_COMMAND_AGE + BEYOND + 1e-9
    gain, posterior = compare_ages(by_age, ages, youngest, oldest)
    late = posterior[ages < youngest].sum(axis=0)
    shift = np.maximum(timing.command_age - ages, 0.0)[:, None]
    delay = np.sum(posterior * shift * (ages < youngest)[:, None], axis=0) / np.maximum(late, 1e-12)
    std = fit_ages(rest[None]).std
    informative = np.any(np.ptp(by_age / std, axis=0) > np.sqrt(2.0 * MIN_LOG_RATIO), axis=1)
    return _Found(gain, late, delay, informative, usual[:, -1], float(std[-1]))
