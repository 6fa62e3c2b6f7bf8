"""Neutral by one who does not drive: when the driver is gone, or by order.

A driver has a guard of its own. Where both die (memory ends, a service is
killed as a whole), the PCA9685 repeats the last throttle for ever. ``Watchman``
sees that nobody holds the port any more and has neutral written for 0.2 s, then
all channels switched off for the rest of a second: without a Nano nobody sees
whether the neutral drives the car. A throttle channel that is off stays off.
It arms nothing, wakes nothing, and leaves a car alone that somebody drives.
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
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES, Pca9685
from dart_hal.devices.actuation.quantiser import NOMINAL_HZ, Quantiser

LOOK_EVERY = 0.1
"""s between two looks at who drives."""
WRITES = 50
"""Writes that must succeed: one second, as the guard's last words."""
GRACE = 1.0
"""s that a driver gets to leave at neutral by itself: two PWM frames and a join."""


class Throttle:
    """The throttle channel of a car, and its neutral."""

    def __init__(self, files: CarFiles, bus: Bus, sleep: Callable[[float], None]) -> None:
        car, clock = files.config, files.oscillator_hz
        self._channel = car.throttle.channel
        self._pca = Pca9685(bus, address=car.pwm.address, frequency=car.pwm.frequency,
                            channels=(car.steering.channel, car.throttle.channel), sleep=sleep,
                            oscillator_hz=clock.value if clock else NOMINAL_HZ)
        self.neutral = Quantiser(self._pca.count_us).rest(files.neutral_us)
        """Counts."""

    @property
    def pulse_us(self) -> float:
        """The pulse that the registers hold [us]; 0 = off. Raises BusError."""
        return self._pca.pulse_counts(self._channel) * self._pca.count_us

    @property
    def is_off(self) -> bool:
        """Whether neither ESC nor servo gets a pulse, as the registers say."""
        return self._pca.is_off()

    def rest(self) -> bool:
        """Write neutral; channels that are off stay off. Raises BusError.

        False: the chip is not set up as ours, all is off.
        """
        return self._pca.rest(self.neutral)

    def switch_off(self) -> None:
        """End the pulses of all channels. Raises BusError."""
        self._pca.all_off()


class Watchman:
    """When to write neutral, free of I/O: who drives and the time are arguments."""

    def __init__(self) -> None:
        self.owed = WRITES
        """Writes still to be made: also at the start, when nobody drives."""
        self.driver: int | None = None
        self._next = -math.inf

    def see(self, driver: int | None) -> None:
        """Who holds the port now; one who drives owes nothing, one who left owes a second."""
        if driver is not None:
            self.owed = 0
        elif self.driver is not None:
            self.owed = WRITES
        self.driver = driver

    @property
    def switches_off(self) -> bool:
        """Whether the next write switches all channels off; else it is neutral."""
        return self.owed <= WRITES - NEUTRAL_FRAMES

    def due(self, now: float) -> bool:
        """Whether something must be written now."""
        return self.owed > 0 and now >= self._next

    def wrote(self, ok: bool, now: float) -> None:
        """The outcome of a write; one that failed is tried again."""
        self._next = now + PWM_FRAME
        self.owed -= ok


@dataclass(frozen=True, slots=True)
class Stopped:
    """What ``stop`` met and left. Pulses in us, 0 = off; ``driver`` still drives, None = none.

    ``at_rest``: neither ESC nor servo gets a pulse.
    """

    found_us: float
    left_us: float
    ended: int | None
    driver: int | None
    at_rest: bool


def stop(throttle: Throttle, holder: Callable[[], int | None],
         sleep: Callable[[float], None]) -> Stopped:
    """Neutral at once, then end the driver (SIGTERM), then all channels off for a second.

    Raises BusError when that could not be written.
    """
    found = throttle.pulse_us
    throttle.rest()
    ended = holder()
    if ended:
        with suppress(ProcessLookupError, PermissionError):    # told by ``driver`` below
            os.kill(ended, signal.SIGTERM)
        _while_driven(throttle, holder, sleep)
    for write in range(WRITES):
        if write < NEUTRAL_FRAMES:
            throttle.rest()
        else:
            throttle.switch_off()
        sleep(PWM_FRAME)
    return Stopped(found, throttle.pulse_us, ended, holder(), throttle.is_off)


def _while_driven(throttle: Throttle, holder: Callable[[], int | None],
                  sleep: Callable[[float], None]) -> None:
    """Wait for the driver to leave, neutral all the while."""
    for _ in range(round(GRACE / PWM_FRAME)):
        if holder() is None:
            return
        throttle.rest()
        sleep(PWM_FRAME)
