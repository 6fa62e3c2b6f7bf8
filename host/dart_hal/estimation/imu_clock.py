"""Time at which the IMU took a sample, from the beat of its own clock against that of the Nano.

The BNO055 renews its data every 10 ms of its own clock, the Nano reads them every 10 ms of its
own: the age of a sample is a sawtooth at the beat of the two. In each slot of 10 ms the firmware
reads the gyro twice: first the *look*, then, LOOK_TIME later, the *read* whose values count. It
reports where the data changed:

             last read -> look   look -> read   so the sample is
    BEFORE   change              -              older than LOOK_TIME
    AFTER    -                   change         younger than LOOK_TIME
    BOTH     change              change         just updated: two updates between two reads
    NONE     -                   -              not updated, or to equal values

A Kalman filter estimates the age without wraps, a straight line, and its rate (the difference of
both clock rates). Two kinds of observations:

1. When the answer changes from BEFORE to AFTER or back, the age is at the edge of its region:
   at a wrap of the sawtooth, or at the time from look to read. At a wrap there are two updates
   or none, so one answer shows which edge it is.
2. Between, the age is inside its region.
"""

from __future__ import annotations

from math import inf, isnan, sqrt

# s of a slot of the firmware without the IMU, by its emulator.
SLOT_WORK_TIME = 0.8e-3
# s, one sigma.
SLOT_WORK_STD = 0.3e-3
# Share of the time for the IMU in a slot until the gyro is read. A slot reads acceleration (3
# bytes of addresses and 6 of data), gyro (3 and 6) and sometimes a status (4): the gyro registers
# are taken after the 12th of 22 bytes. 2.44 ms at 180 us of stretching per byte.
GYRO_READ_SHARE = 12 / 22
# s from the begin of the IMU read to that of the gyro and one sigma, if the Nano does not report
# the length of its slots: 12 bytes of 22.5 us, each stretched by 0 to 180 us.
DEFAULT_GYRO_READ = (12 * 112.5e-6, 0.62e-3)
# s of those bytes without stretching.
MIN_GYRO_READ_TIME = 12 * 22.5e-6
NONE, BEFORE, AFTER, BOTH = range(4)
# s of the fusion clock, and of a slot. The clocks differ by less than a percent, 0.1 ms of an age.
PERIOD = 0.010
# s from the look at the gyro to its read: 4.9 for a part that stretches the clock by 180 us a
# byte, 3.6 at 50 us (emulated firmware).
LOOK_TIME = 4.8e-3
# s, one sigma of the age when it passes LOOK_TIME: spread as above, phases of the slot.
LOOK_STD = 1.0e-3
# s, one sigma of the age at a wrap.
READ_STD = 0.2e-3
# Relative rate of the two clocks: a ceramic resonator is good to 0.5 %.
CLOCK_RATE_STD = 5e-3
# per sqrt(s): the rate changes by 3e-5 in 100 s, as a resonator of 20 ppm/K that warms by 1 K.
CLOCK_RATE_WALK = 3e-6
# Standard deviations beyond which an edge is not noise: the clock has jumped, the filter restarts.
MAX_INNOVATION_SIGMAS = 4.0
# s between two reads beyond which the age is not extrapolated.
MAX_READ_GAP = 0.5
# Reads without any change: that IMU is stuck, or simulated without noise.
MAX_BLANK_READS = 5
# s, one sigma of an unknown age: uniform within a period.
AGE_STD = PERIOD / sqrt(12.0)


def gyro_read_delay(slot: float) -> tuple[float, float]:
    """Compute the time from the begin of the IMU read to that of the gyro, and one sigma [s].

    slot [s]: the longest turn of the firmware's loop with its read of the IMU, as DIAG reports it
    (``loop_max_us``); nan = no DIAG was received.
    """
    if isnan(slot):
        return DEFAULT_GYRO_READ
    return max(GYRO_READ_SHARE * (slot - SLOT_WORK_TIME), MIN_GYRO_READ_TIME), SLOT_WORK_STD


class ImuClock:
    """Estimates the age of the samples; call ``sample_time`` once per frame.

    ``std`` [s]: one sigma of the age, AGE_STD while there are no looks.
    """

    def __init__(self) -> None:
        self._read: float | None = None
        self.restart()

    def restart(self) -> None:
        """Start again with an unknown age: the Nano, or the IMU, restarted."""
        self._age = 0.5 * PERIOD
        self._rate = 0.0
        self._reset_filter()
        self._wraps = 0
        self._region = NONE
        self._blank_reads = 0
        self._sample_time: float | None = None

    def _reset_filter(self) -> None:
        """Set the covariance of age and rate to that of unknown ones."""
        self._aa = AGE_STD**2
        self._ar = 0.0
        self._rr = CLOCK_RATE_STD**2
        self._last_was_wrap: bool | None = None
        self._corrected_last = False

    @property
    def std(self) -> float:
        """Return the standard deviation of the age [s]."""
        return AGE_STD if self._sample_time is None else min(sqrt(self._aa), AGE_STD)

    @property
    def rate(self) -> float:
        """Growth of the age of the samples in seconds per second; negative: they get younger."""
        return self._rate

    def sample_time(self, read: float, look: int) -> float | None:
        """Return the device time [s] of the update that a read got, None = not known.

        read [s]: device time at which the gyro was read; look: see the module docstring.
        """
        step = read - self._read if self._read is not None else inf
        if abs(step) < 0.5 * PERIOD:
            return self._sample_time
        self._read = read
        if not 0.0 <= step < MAX_READ_GAP:
            self.restart()
        else:
            self._predict(step)
        if look == NONE:
            self._blank_reads += 1
            if self._blank_reads > MAX_BLANK_READS:
                self._region = NONE
                self._sample_time = None
            return self._sample_time
        low, high = self._use_look(look)
        self._blank_reads = 0
        self._sample_time = read + self._wraps * PERIOD - min(max(self._age, low), high)
        return self._sample_time

    def mean_read(self, read: float, look: int) -> float:
        """Return the device time [s] of a read that would find the sample at its mean age.

        That is the time of the sample plus its mean age of half a period, so that ``GYRO_LATENCY``
        applies to it as to any read. It is ``read`` itself if the age is not known.
        """
        sample_time = self.sample_time(read, look)
        return read if sample_time is None else sample_time + 0.5 * PERIOD

    def _predict(self, step: float) -> None:
        """Advance age and covariance by ``step`` s; a late read finds an older sample."""
        self._age += self._rate * step + step - PERIOD * round(step / PERIOD)
        self._aa += (2.0 * self._ar + self._rr * step) * step
        self._ar += self._rr * step
        self._rr += CLOCK_RATE_WALK**2 * step

    def _use_look(self, look: int) -> tuple[float, float]:
        """Update with one look; return its range of ages [s], without wraps as ``_age``."""
        region = BEFORE if look == BEFORE else AFTER
        before = self._region
        self._region = region
        younger = region == AFTER
        if before not in (NONE, region):
            self._observe_edge(look == BOTH if younger else self._blank_reads > 0, younger)
        wrap_offset = self._wraps * PERIOD
        low = wrap_offset + (0.0 if younger else LOOK_TIME - LOOK_STD)
        high = wrap_offset + (LOOK_TIME + LOOK_STD if younger else PERIOD)
        self._observe_region(low, high)
        return low, high

    def _observe_region(self, low: float, high: float) -> None:
        """Update with an age between two bounds [s]; its variance is at most that of the region.

        The observation is scaled so that the variance becomes that of a uniform distribution in the
        region: the rate is then known as well as the time spent inside allows.
        """
        uniform = (high - low)**2 / 12.0
        outside = max(low - self._age, self._age - high)
        if outside > 0.0 and outside * outside > MAX_INNOVATION_SIGMAS**2 * self._aa:
            self._reset_filter()
        if self._aa > uniform:
            self._observe(0.5 * (low + high), self._aa * uniform / (self._aa - uniform))

    def _observe_edge(self, wrap: bool, younger: bool) -> None:
        """Update with the age at an edge of its region: at a ``wrap``, or at LOOK_TIME.

        Both kinds alternate: the same one twice in a row is jitter of the reads and is not used.
        If an update changed nothing, the edges are confused; a large offset shows this.
        """
        offset, variance = self._edge_offset(wrap)
        if offset * offset > MAX_INNOVATION_SIGMAS**2 * (self._aa + variance):
            other_offset, other_variance = self._edge_offset(not wrap)
            if self._corrected_last or other_offset * other_offset > (
                    MAX_INNOVATION_SIGMAS**2 * (self._aa + other_variance)):
                self._reset_filter()
            else:
                self._corrected_last = True
                wrap = not wrap
                offset = other_offset
                variance = other_variance
        else:
            self._corrected_last = False
        edge = self._age + offset
        if wrap is not self._last_was_wrap:
            self._observe(edge, variance)
        self._last_was_wrap = wrap
        region_end = (0.0 if younger else PERIOD) if wrap else LOOK_TIME
        self._wraps = round((edge - region_end) / PERIOD)

    def _edge_offset(self, wrap: bool) -> tuple[float, float]:
        """Distance of an edge from the age [s], modulo the period, and its variance [s2]."""
        offset = (0.0 if wrap else LOOK_TIME) - self._age
        return offset - PERIOD * round(offset / PERIOD), (READ_STD if wrap else LOOK_STD)**2

    def _observe(self, age: float, variance: float) -> None:
        """Kalman update with an observed ``age`` [s] of this ``variance`` [s2]."""
        total = self._aa + variance
        gain = self._aa / total
        rate_gain = self._ar / total
        innovation = age - self._age
        self._age += gain * innovation
        self._rate += rate_gain * innovation
        self._rr -= rate_gain * self._ar
        self._ar *= 1.0 - gain
        self._aa *= 1.0 - gain
