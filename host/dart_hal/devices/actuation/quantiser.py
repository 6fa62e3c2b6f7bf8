"""Pulse width to PCA9685 counts with error feedback.

One count of the 12-bit counter is (prescale + 1) / oscillator, 4.88 us at 121
and 25 MHz: 0.4 deg of road wheel. Rounding each pulse by itself leaves a
constant error of up to half of that. Here the error of one PWM frame is added
to the next, so that servo and ESC, which are slower than a frame, see the
mean: below 0.05 us over 50 frames, and no pulse more than one count off.
``[pwm] error_feedback = false`` in car.toml gives the nearest count instead, the same
in every frame: for a servo that hums, or to see a single step.
"""

from __future__ import annotations

import math

from dart_hal.core.config import CarFiles

NOMINAL_HZ = 25e6
"""The PCA9685's oscillator by its data sheet; parts from 24 to 27 MHz are seen."""

STEPS = 4096
"""Counts of one PWM frame."""


def prescale_for(frequency: float, oscillator_hz: float = NOMINAL_HZ) -> int:
    """PRE_SCALE that brings a PWM frequency [Hz] closest, by ServoKit's formula.

    With the clock as it was measured the frequency is kept within 0.4 %, half a step; parts at
    24 and 27 MHz would be 4 and 8 % off. It changes only where the clock is calibrated anew.
    """
    return int(oscillator_hz / STEPS / frequency + 0.5) - 1


def counter_of(files: CarFiles) -> tuple[int, float]:
    """(PRE_SCALE, one count [us]) of a car's PCA9685, by its measured clock if it has one."""
    clock = files.oscillator_hz
    hertz = clock.value if clock else NOMINAL_HZ
    prescale = prescale_for(files.config.pwm.frequency, hertz)
    return prescale, count_us(prescale, hertz)


def count_us(prescale: int, oscillator_hz: float) -> float:
    """Length of one count [us]."""
    return (prescale + 1) / oscillator_hz * 1e6


class Quantiser:
    """Counts of one channel; ``step`` is called once per PWM frame.

    ``feedback`` False: each pulse is rounded by itself.
    """

    def __init__(self, count: float, feedback: bool = True) -> None:
        self.count = count
        """One count [us]."""
        self._feedback = feedback
        self.error = 0.0
        """Pulse time still owed [us], within half a count."""

    def peek(self, pulse_us: float) -> int:
        """Counts that ``step`` would return; nothing changes."""
        wanted = math.floor((pulse_us + self.error) / self.count + 0.5)
        return min(max(wanted, 1), STEPS - 1)

    def step(self, pulse_us: float) -> int:
        """Counts for this frame; the rest is owed to the next."""
        if not self._feedback:
            return self.settle(pulse_us)
        counts = self.peek(pulse_us)
        owed = self.error + pulse_us - counts * self.count
        half = 0.5 * self.count
        self.error = min(max(owed, -half), half)      # only the ends of the range can exceed it
        return counts

    def rest(self, pulse_us: float) -> int:
        """Counts of a pulse that stands still: the nearest; nothing changes."""
        return min(max(math.floor(pulse_us / self.count + 0.5), 1), STEPS - 1)

    def settle(self, pulse_us: float) -> int:
        """Counts of a pulse that stands still from now on; what was owed is forgotten."""
        self.error = 0.0
        return self.rest(pulse_us)
