"""When the IMU took a sample: the beat of its own clock against the Nano's.

The BNO055 renews its data every 10 ms of its own clock, the Nano reads them every 10 ms of its
own: the age of a sample slides through a sawtooth at the beat of the two. The firmware looks at
the gyro a second time in each slot, before the read, and says where the data changed:

    look     read before | look | read     the sample is
    BEFORE          change              older than the time from look to read
    AFTER                   change      younger
    BOTH            change  change      two updates between two reads: a moment old
    NONE                                no update (or one that changed nothing)

The age, counted on over the wraps, goes along a line: phase and rate of the IMU's clock, by a
Kalman filter. It is told the edge of a region each time that the age comes by one, which is when
the answer changes; between, that the age is inside. At a wrap there are two updates or none, so
the direction needs no history.
"""

from __future__ import annotations

from math import inf, isnan, sqrt

WORK, WORK_STD = 0.8e-3, 0.3e-3
"""s of a slot of the firmware without the IMU, by its emulator, and one sigma."""
GYRO_SHARE = 12 / 22
"""Of the time that a slot spends on the IMU, until the gyro is read. A slot reads acceleration
(3 bytes of addresses and 6 of data), gyro (3 and 6) and sometimes a status (4): the gyro's
registers are taken after the 12th of 22 bytes. 2.44 ms at 180 us of stretching per byte."""
GYRO_READ = (12 * 112.5e-6, 0.62e-3)
"""s from the begin of the IMU's read to that of the gyro and one sigma, where the Nano does not
report the length of its slots: 12 bytes of 22.5 us, each stretched by 0 to 180 us."""
QUICKEST = 12 * 22.5e-6
"""s of those bytes without stretching."""
NONE, BEFORE, AFTER, BOTH = range(4)
PERIOD = 0.010
"""s of the fusion clock, and of a slot. True to the percent that the clocks are apart by, which
is 0.1 ms of an age."""
LOOK = 4.8e-3
"""s from the look at the gyro to the read of it: 4.9 of a part that stretches the clock by 180 us
a byte, 3.6 at 50 us (emulated firmware)."""
LOOK_STD, READ_STD = 1.0e-3, 0.2e-3
"""s by which the age may be off when it passes LOOK, or 0: LOOK as above, phases of the slot."""
RATE_STD = 5e-3
"""Of the two clocks against each other: a ceramic resonator is good to 0.5 %."""
WANDER = 3e-6
"""per sqrt(s): the rate goes 3e-5 in 100 s, as a resonator of 20 ppm/K that warms by a degree."""
SURPRISE = 4.0
"""Deviations beyond which an edge is no noise: the clock has jumped, all is learnt anew."""
LONGEST = 0.5
"""s between two reads beyond which the age is not carried on."""
BLANKS = 5
"""Reads without any change: that IMU is stuck, or stands in a world without noise."""
AGE_STD = PERIOD / sqrt(12.0)
"""s, one sigma of an age of which nothing is known."""


def gyro_read_delay(slot: float) -> tuple[float, float]:
    """Compute the time from the begin of the IMU's read to that of the gyro, and one sigma [s].

    slot [s]: the longest turn of the firmware's loop with its read of the IMU, as DIAG reports it
    (``loop_max_us``); nan = no DIAG was received.
    """
    if isnan(slot):
        return GYRO_READ
    return max(GYRO_SHARE * (slot - WORK), QUICKEST), WORK_STD


class ImuClock:
    """Follows the age of the samples; call ``sampled`` once per frame.

    ``std`` [s]: one sigma of the age, AGE_STD while there are no looks.
    """

    def __init__(self) -> None:
        self._read: float | None = None
        self.restart()

    def restart(self) -> None:
        """The Nano, or the IMU, began anew."""
        self._age, self._rate = 0.5 * PERIOD, 0.0
        self._forget()
        self._wraps = 0
        self._region = NONE
        self._blanks = 0
        self._sampled: float | None = None

    def _forget(self) -> None:
        self._aa, self._ar, self._rr = AGE_STD**2, 0.0, RATE_STD**2
        self._wrapped: bool | None = None
        self._mistaken = False

    @property
    def std(self) -> float:
        return AGE_STD if self._sampled is None else min(sqrt(self._aa), AGE_STD)

    @property
    def rate(self) -> float:
        """Seconds by which the samples grow older (negative: younger) in a second."""
        return self._rate

    def sampled(self, read: float, look: int) -> float | None:
        """Device time [s] of the update that a read got, None = not known.

        read [s]: device time at which the gyro was read; look: see the head of this file.
        """
        step = read - self._read if self._read is not None else inf
        if abs(step) < 0.5 * PERIOD:
            return self._sampled
        self._read = read
        if not 0.0 <= step < LONGEST:
            self.restart()
        else:
            self._predict(step)
        if look == NONE:
            self._blanks += 1
            if self._blanks > BLANKS:
                self._region, self._sampled = NONE, None
            return self._sampled
        low, high = self._learn(look)
        self._blanks = 0
        self._sampled = read + self._wraps * PERIOD - min(max(self._age, low), high)
        return self._sampled

    def mean_read(self, read: float, look: int) -> float:
        """Device time [s] of a read that finds the sample at its mean age; ``read`` if not known.

        What uses it need not know whether there are looks.
        """
        sampled = self.sampled(read, look)
        return read if sampled is None else sampled + 0.5 * PERIOD

    def _predict(self, step: float) -> None:
        """A read ``step`` s later; one that comes late finds an older sample."""
        self._age += self._rate * step + step - PERIOD * round(step / PERIOD)
        self._aa += (2.0 * self._ar + self._rr * step) * step
        self._ar += self._rr * step
        self._rr += WANDER**2 * step

    def _learn(self, look: int) -> tuple[float, float]:
        """What an answer tells; the ages [s] that go with it, counted on as ``_age`` is."""
        region = BEFORE if look == BEFORE else AFTER
        before, self._region = self._region, region
        younger = region == AFTER
        if before not in (NONE, region):
            self._edge(look == BOTH if younger else self._blanks > 0, younger)
        turn = self._wraps * PERIOD
        low = turn + (0.0 if younger else LOOK - LOOK_STD)
        high = turn + (LOOK + LOOK_STD if younger else PERIOD)
        self._inside(low, high)
        return low, high

    def _inside(self, low: float, high: float) -> None:
        """The age is between two bounds [s], and cannot be less sure than that.

        The information that this takes is what keeps the variance at that of the region: the rate
        is then known to its deviation over the time that has passed in there.
        """
        widest = (high - low)**2 / 12.0
        off = max(low - self._age, self._age - high)
        if off > 0.0 and off * off > SURPRISE**2 * self._aa:
            self._forget()
        if self._aa > widest:
            self._observe(0.5 * (low + high), self._aa * widest / (self._aa - widest))

    def _edge(self, wrap: bool, younger: bool) -> None:
        """The age has come by the edge of its region: by a ``wrap``, or by LOOK.

        The two take turns: one twice in a row is the jitter of the reads, and tells no more. One
        taken for the other, where an update has changed nothing, is known by being far off.
        """
        off, variance = self._off(wrap)
        if off * off > SURPRISE**2 * (self._aa + variance):
            other, other_variance = self._off(not wrap)
            if self._mistaken or other * other > SURPRISE**2 * (self._aa + other_variance):
                self._forget()
            else:
                self._mistaken = True
                wrap, off, variance = not wrap, other, other_variance
        else:
            self._mistaken = False
        edge = self._age + off
        if wrap is not self._wrapped:
            self._observe(edge, variance)
        self._wrapped = wrap
        ends = (0.0 if younger else PERIOD) if wrap else LOOK
        self._wraps = round((edge - ends) / PERIOD)

    def _off(self, wrap: bool) -> tuple[float, float]:
        """How far an edge [s] is from the age, whatever the turn; its variance [s2]."""
        off = (0.0 if wrap else LOOK) - self._age
        return off - PERIOD * round(off / PERIOD), (READ_STD if wrap else LOOK_STD)**2

    def _observe(self, age: float, variance: float) -> None:
        """The age is ``age`` [s], with a ``variance`` [s2]."""
        total = self._aa + variance
        gain, rate_gain = self._aa / total, self._ar / total
        off = age - self._age
        self._age += gain * off
        self._rate += rate_gain * off
        self._rr -= rate_gain * self._ar
        self._ar *= 1.0 - gain
        self._aa *= 1.0 - gain
