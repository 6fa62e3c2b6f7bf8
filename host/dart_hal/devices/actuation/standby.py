"""Neutral from a process that does not drive: when the driver is gone, or on request.

A driver has a guard process. If both die (out of memory, or a service is killed with all its
processes), the PCA9685 repeats the last throttle for ever. ``Watchman`` then finds that no process
holds the port, and requests 0.2 s of neutral, then all channels off for the rest of a second:
without a Nano no sensor shows whether the neutral drives the car. A throttle channel that is off
stays off. It never arms, never wakes the chip, and writes nothing while another program drives.
"""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from dart_hal.core.config import CarFiles
from dart_hal.core.ports import Bus
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.pca9685 import FINAL_WRITES, NEUTRAL_FRAMES, Pca9685
from dart_hal.devices.actuation.quantiser import NOMINAL_HZ, Quantiser

# s between two checks of which program drives.
POLL_INTERVAL = 0.1
# s for a driver to end at neutral by itself: two PWM frames and the join of a thread.
DRIVER_EXIT_TIME = 1.0


class Throttle:
    """The throttle channel of a car, and its neutral."""

    def __init__(self, files: CarFiles, bus: Bus, sleep: Callable[[float], None]) -> None:
        car = files.config
        clock = files.oscillator_hz
        self._channel = car.throttle.channel
        self._pca = Pca9685(bus, address=car.pwm.address, frequency=car.pwm.frequency,
                            channels=(car.steering.channel, car.throttle.channel), sleep=sleep,
                            oscillator_hz=clock.value if clock else NOMINAL_HZ)
        self.neutral = Quantiser(self._pca.count_us).rest(files.neutral_us)
        """Counts."""

    @property
    def is_recognised(self) -> bool:
        """Whether the chip has been found to be a PCA9685; no other device gets a write."""
        return self._pca.recognised

    @property
    def pulse_us(self) -> float:
        """Pulse [us] in the registers; 0 = off. Raises BusError."""
        return self._pca.pulse_counts(self._channel) * self._pca.count_us

    @property
    def is_off(self) -> bool:
        """Whether neither ESC nor servo gets a pulse, by the registers."""
        return self._pca.is_off()

    def rest(self) -> bool:
        """Write neutral; channels that are off stay off. Raises BusError.

        Returns False if the chip is not set up for this car: then all channels are off.
        """
        return self._pca.rest(self.neutral)

    def switch_off(self) -> None:
        """End the pulses of all channels. Raises BusError."""
        self._pca.all_off()


class Watchman:
    """When to write neutral, without I/O: the driver's process id and the time are arguments."""

    def __init__(self) -> None:
        self.owed = FINAL_WRITES
        """Writes to be made; also at the start, when no program drives."""
        self.driver: int | None = None
        self._next = -math.inf

    def note_driver(self, driver: int | None) -> None:
        """Enter the process that holds the port now [None = none]; its end requests the writes."""
        if driver is not None:
            self.owed = 0
        elif self.driver is not None:
            self.owed = FINAL_WRITES
        self.driver = driver

    @property
    def switches_off(self) -> bool:
        """Whether the next write switches all channels off; otherwise it is neutral."""
        return self.owed <= FINAL_WRITES - NEUTRAL_FRAMES

    def due(self, now: float) -> bool:
        """Return whether a write is due now."""
        return self.owed > 0 and now >= self._next

    def note_write(self, ok: bool, now: float) -> None:
        """Enter the outcome of a write; a failed write is repeated."""
        self._next = now + PWM_FRAME
        self.owed -= ok


@dataclass(frozen=True, slots=True)
class StopResult:
    """Result of ``stop``.

    found_us, left_us: throttle pulse before and after it, 0 = off; ended: process that received
    SIGTERM; driver: process that drives after it, None = none; at_rest: neither ESC nor servo gets
    a pulse.
    """

    found_us: float
    left_us: float
    ended: int | None
    driver: int | None
    at_rest: bool


def stop(throttle: Throttle, holder: Callable[[], int | None],
         sleep: Callable[[float], None]) -> StopResult:
    """Stop the car from another process. Raises BusError when a write fails.

    1. Write neutral at once.
    2. Send SIGTERM to the driver, and repeat neutral until it has ended, for at most
       DRIVER_EXIT_TIME.
    3. Write neutral for NEUTRAL_FRAMES, then switch all channels off, FINAL_WRITES in total; the
       latter also after an error or Ctrl-C.
    """
    try:
        found = throttle.pulse_us
        throttle.rest()
        ended = holder()
        if ended:
            with suppress(ProcessLookupError, PermissionError):    # reported as ``driver`` below
                os.kill(ended, signal.SIGTERM)
            _wait_for_exit(throttle, holder, sleep)
        for _ in range(NEUTRAL_FRAMES):
            throttle.rest()
            sleep(PWM_FRAME)
    finally:  # also after Ctrl-C or a failed write: a neutral pulse must not stay
        for _ in range(FINAL_WRITES - NEUTRAL_FRAMES if throttle.is_recognised else 0):
            throttle.switch_off()
            sleep(PWM_FRAME)
    return StopResult(found, throttle.pulse_us, ended, holder(), throttle.is_off)


def _wait_for_exit(throttle: Throttle, holder: Callable[[], int | None],
                   sleep: Callable[[float], None]) -> None:
    """Wait for the driver to end, and write neutral meanwhile."""
    for _ in range(round(DRIVER_EXIT_TIME / PWM_FRAME)):
        if holder() is None:
            return
        throttle.rest()
        sleep(PWM_FRAME)
