"""Conversion of a pulse width to PCA9685 counts, with error feedback.

One count of the 12-bit counter is (prescale + 1) / oscillator: 4.88 us at prescale 121 and 25 MHz,
which is 0.4 deg of road wheel. Rounding each pulse by itself leaves a constant error of up to half
a count. With error feedback (first-order noise shaping), frame k writes

    n_k = round((p_k + e_k) / c),    e_(k+1) = p_k + e_k - n_k c

with pulse p [us], count length c [us] and error e [us]. Servo and ESC are slower than a frame and
respond to the mean pulse. Its error is below 0.05 us over 50 frames, and no pulse is more than one
count off. ``[pwm] error_feedback = false`` in car.toml gives the nearest count instead, the same in
every frame: for a servo that hums, or to measure a single step.
"""

from __future__ import annotations

import math

from dart_hal.core.config import CarFiles

# Oscillator of the PCA9685 by its data sheet [Hz]; measured parts have 24 to 27 MHz.
NOMINAL_HZ = 25e6

# The PCA9685 has a 12-bit counter.
COUNTS_PER_FRAME = 4096


def prescale_for(frequency: float, oscillator_hz: float = NOMINAL_HZ) -> int:
    """Return the PRE_SCALE whose PWM frequency [Hz] is closest, by ServoKit's formula.

    With the measured clock the frequency is accurate to 0.4 %, half a step; with the nominal clock
    it would be 4 and 8 % off for parts at 24 and 27 MHz.
    """
    return int(oscillator_hz / COUNTS_PER_FRAME / frequency + 0.5) - 1


def counter_of(files: CarFiles) -> tuple[int, float]:
    """Return (PRE_SCALE, one count [us]) of a car's PCA9685, by the measured clock if known."""
    clock = files.oscillator_hz
    hertz = clock.value if clock else NOMINAL_HZ
    prescale = prescale_for(files.config.pwm.frequency, hertz)
    return prescale, count_us(prescale, hertz)


def count_us(prescale: int, oscillator_hz: float) -> float:
    """Return the length of one count [us]."""
    return (prescale + 1) / oscillator_hz * 1e6


class Quantiser:
    """Converts the pulses of one channel to counts; call ``step`` once per PWM frame.

    count [us]: length of one count; ``feedback`` False: each pulse is rounded by itself.
    """

    def __init__(self, count: float, feedback: bool = True) -> None:
        self.count = count
        self._feedback = feedback
        self.error = 0.0
        """Error e of the equation above [us], within half a count."""

    def peek(self, pulse_us: float) -> int:
        """Return the counts that ``step`` would return, without changing the error."""
        counts = math.floor((pulse_us + self.error) / self.count + 0.5)
        return min(max(counts, 1), COUNTS_PER_FRAME - 1)

    def step(self, pulse_us: float) -> int:
        """Return the counts of this frame and update the error."""
        if not self._feedback:
            return self.settle(pulse_us)
        counts = self.peek(pulse_us)
        error = self.error + pulse_us - counts * self.count
        half = 0.5 * self.count
        self.error = min(max(error, -half), half)     # only the ends of the range can exceed it
        return counts

    def rest(self, pulse_us: float) -> int:
        """Return the nearest counts of a constant pulse, without changing the error."""
        return min(max(math.floor(pulse_us / self.count + 0.5), 1), COUNTS_PER_FRAME - 1)

    def settle(self, pulse_us: float) -> int:
        """Return the nearest counts of a pulse that is constant from now on; reset the error."""
        self.error = 0.0
        return self.rest(pulse_us)
