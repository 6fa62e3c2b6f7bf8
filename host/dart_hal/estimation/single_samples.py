"""Reject single wrong samples of an IMU: a jump that returns in the next sample is no motion.

A flipped bit changes one sample and leaves its neighbours right. A car cannot do that: its yaw
rate is the integral of a torque and passes a 32 Hz filter, so a real jump stays. Per channel:

1. A sample that differs by more than a threshold from the last accepted one, and from the line
   through the last two, is withheld. Until it is decided, the last accepted value counts.
2. The next sample decides. If the withheld one lies outside the interval between its neighbours,
   by more than the threshold, more than the neighbours differ and more than the step before it,
   it is rejected: integration then runs along the line from neighbour to neighbour. Otherwise it
   was motion (the peak of a fast oscillation rises in several steps) and is integrated at its own
   time, one sample late.
3. What the threshold cannot separate from noise stays in the integral. Its size is the difference
   between the integral of the samples and that of their running median of five, to which one or
   two wrong samples contribute nothing. This difference is reported with every sample, so that
   the covariance can carry it: two wrong samples in a row are accepted and covered.

The threshold follows the noise: a multiple of the mean distance of accepted samples from the line
between their neighbours (half of the second difference).
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import inf
from typing import NamedTuple

# rad/s: 7 sigma of the BNO055's noise in one sample (4e-3). Smaller jumps are not withheld.
MIN_RATE_JUMP = 0.03
# m/s2: 0.01 m/s in one sample of 10 ms, a twenty-fifth of the change of speed that decides the
# direction of travel (0.25 m/s). The noise of one sample is 0.015 m/s2.
MIN_ACCELERATION_JUMP = 1.0
# Threshold in those mean distances: Gaussian noise exceeds it once in 1e6 samples.
NOISE_FACTOR = 6.0
# Accepted samples, 1 s, over which the distance is averaged.
NOISE_SAMPLES = 100
# s from the sample before a jump to the one after it: one missing frame is allowed. In a longer
# time a true motion may come and go.
MAX_JUMP_TIME = 0.035
# The median of five ignores two wrong samples in a row.
MEDIAN_SAMPLES = 5

# Share of the largest step between two samples by which both wrong samples of a pair exceed the
# median: all of it but for noise and motion. A smooth peak five samples wide exceeds it by 0.3.
PAIR_SHARE = 0.7


class AcceptedSample(NamedTuple):
    """Contribution of one sample.

    value, stamp: the newest accepted value and its stamp [s]. withheld_sample: the one before it,
    (stamp, value), that was withheld and proved to be motion. variance: of the integral, by a
    sample that was rejected now. residual: integral of sample minus median, newly known.
    """

    value: float
    stamp: float
    withheld_sample: tuple[float, float] | None = None
    variance: float = 0.0
    residual: float = 0.0


class TimedSample(NamedTuple):
    """A sample read at t [s]; stamp [s]: the time at which it is integrated."""

    t: float
    value: float
    stamp: float


NO_SAMPLE = TimedSample(-inf, 0.0, -inf)


class SingleSampleFilter:
    """Accepts or rejects the samples of one channel; call ``add`` once for each new sample.

    ``rejected``: number of rejected samples; ``pairs``: of two samples that jumped and returned
    together, which are accepted. min_jump: smallest jump that is withheld, in the unit of the
    channel.
    """

    def __init__(self, min_jump: float) -> None:
        self.rejected = 0
        self.pairs = 0
        self._min_jump = min_jump
        self._noise = 0.0
        self.restart()

    def restart(self) -> None:
        """Forget all samples: after a pause they do not predict the next one."""
        self._before = self._last = NO_SAMPLE
        self._withheld: TimedSample | None = None
        self._recent: deque[TimedSample] = deque(maxlen=MEDIAN_SAMPLES)

    @property
    def threshold(self) -> float:
        """Jump beyond which a sample is withheld, in the unit of the channel."""
        return max(self._min_jump, NOISE_FACTOR * self._noise)

    def add(self, t: float, value: float, stamp: float) -> AcceptedSample:
        """Judge the sample ``value`` that was read at ``t`` [s]; the same ``t`` changes nothing.

        stamp [s]: the time at which it is integrated, from another clock model than ``t``.
        """
        last = self._last
        withheld = self._withheld
        if t <= last.t or (withheld is not None and t <= withheld.t):
            return AcceptedSample(last.value, last.stamp)
        sample = TimedSample(t, value, stamp)
        if t - last.t > MAX_JUMP_TIME:
            return self._resume(sample)
        if withheld is not None:
            return self._decide(sample, withheld)
        if self._jumps(sample):
            self._withheld = sample
            return AcceptedSample(last.value, last.stamp)
        return AcceptedSample(value, stamp, residual=self._accept(sample))

    def _resume(self, sample: TimedSample) -> AcceptedSample:
        """Begin again after a pause; a sample that nothing can decide any more is motion."""
        withheld = self._withheld
        self.restart()
        self._accept(sample)
        withheld_sample = (withheld.stamp, withheld.value) if withheld is not None else None
        return AcceptedSample(sample.value, sample.stamp, withheld_sample)

    def _jumps(self, sample: TimedSample) -> bool:
        """Whether the sample is far from the last one and from the line through the last two."""
        last = self._last
        jump = sample.value - last.value
        if abs(jump) <= self.threshold or self._before is NO_SAMPLE:
            return abs(jump) > self.threshold
        slope = (last.value - self._before.value) / (last.t - self._before.t)
        return abs(jump - slope * (sample.t - last.t)) > self.threshold

    def _decide(self, sample: TimedSample, withheld: TimedSample) -> AcceptedSample:
        """Step 2: reject the withheld sample, or accept it as motion."""
        self._withheld = None
        begin = self._last
        low = min(begin.value, sample.value)
        high = max(begin.value, sample.value)
        outside = max(withheld.value - high, low - withheld.value)
        before = self._before if self._before is not NO_SAMPLE else begin
        moving = max(high - low, abs(begin.value - before.value))
        if outside > self.threshold and outside > moving:
            self.rejected += 1
            # What the line between the neighbours leaves unknown: the noise, and the difference
            # of the neighbours.
            spread = (self.threshold + high - low) * 0.5 * (sample.t - begin.t)
            return AcceptedSample(sample.value, sample.stamp, None, spread**2, self._accept(sample))
        residual = self._accept(withheld) + self._accept(sample)
        return AcceptedSample(sample.value, sample.stamp, (withheld.stamp, withheld.value), 0.0,
                              residual)

    def _accept(self, sample: TimedSample) -> float:
        """Use the sample; returns the residual of step 3 that it makes known."""
        before = self._before
        last = self._last
        if before is not NO_SAMPLE:
            line = before.value + (sample.value - before.value) * (
                (last.t - before.t) / (sample.t - before.t))
            change = min(abs(last.value - line), self.threshold)
            self._noise += (change - self._noise) / NOISE_SAMPLES
        self._before = last
        self._last = sample
        recent = self._recent
        recent.append(sample)
        if len(recent) < MEDIAN_SAMPLES:
            return 0.0
        middle = MEDIAN_SAMPLES // 2
        values = [known.value for known in recent]
        excess = values[middle] - sorted(values)[middle]
        if abs(excess) > self.threshold:
            self.pairs += self._is_pair(values, excess)
        return excess * (recent[-1].t - recent[0].t) / (MEDIAN_SAMPLES - 1)

    def _is_pair(self, values: list[float], excess: float) -> bool:
        """Whether the middle sample and the one before it jumped together.

        A pair of wrong samples rises in one step, a peak of the motion in several.
        """
        _, before, middle, after, _ = values
        step = PAIR_SHARE * max(abs(b - a) for a, b in pairwise(values))
        same = before - (middle - excess)
        return abs(excess) > step and abs(same) > step and excess * same > 0.0 \
            and abs(after - middle) > step
