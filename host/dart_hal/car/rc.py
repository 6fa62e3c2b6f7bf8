"""The driver with an RC transmitter: when he overrides the program, and with which command.

The Nano measures the pulses of the receiver and sends them at 50 Hz. The override begins when a
stick leaves its dead band, or with the third channel, and ends when both sticks have been in their
dead bands for ``RELEASE_TIME``, or with the third channel. Throttle passes only after its stick
was in the dead band with the car armed. Without a signal during an override the car trips.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any

from dart_hal.core.config.car import CarConfig, RcChannel
from dart_hal.devices.actuation.limits import SourceCommand
from dart_hal.wire.messages import TICKS_PER_SECOND

# s from the end of the newest pulse to a STATE, on the Nano's clock, at which a signal is not lost.
# One missing pulse of 22 ms and the period of the messages make 64 ms. With one more STATE and one
# PWM frame the ESC has neutral within 100 ms.
MAX_PULSE_AGE = 0.065
# s for which both sticks must be in their dead bands until the program drives again: longer than
# the way of a stick from one side to the other.
RELEASE_TIME = 1.0
# us of a pulse: outside there is no signal.
PULSE_RANGE = (800.0, 2200.0)
# us of a count of the Nano's clock.
TICK_US = 1e6 / TICKS_PER_SECOND
TICKS_PER_MS = TICKS_PER_SECOND // 1000
# Ticks: the clock has 32 bits.
HALF_CLOCK = 1 << 31
# Name of the driver among the sources of commands.
RC_SOURCE = "rc"


def scale_stick(pulse_us: float, channel: RcChannel, dead_band_us: float) -> float:
    """Return the position -1 to 1 of a stick: 0 in the dead band, 1 at ``high_us``."""
    offset = pulse_us - channel.center_us
    if abs(offset) <= dead_band_us:
        return 0.0
    # The end on the side of the pulse; high_us may be below low_us.
    toward_high = (offset > 0.0) == (channel.high_us > channel.center_us)
    end = channel.high_us if toward_high else channel.low_us
    share = (abs(offset) - dead_band_us) / (abs(end - channel.center_us) - dead_band_us)
    return min(share, 1.0) * (1.0 if toward_high else -1.0)


class RcOverride:
    """The RC receiver of one open car.

    active: the driver overrides the program; lost: the signal ended while he did, and has not
    returned; pulses_us: newest pulse of steering, throttle and third channel, None: no message
    yet.
    """

    def __init__(self, car: CarConfig) -> None:
        assert car.rc is not None
        self.active = False
        self.lost = False
        self.pulses_us: tuple[float, ...] | None = None
        self._config = car.rc
        self._max_steering = car.limits.max_steering
        self._channels = 2 if car.rc.mode_us is None else 3
        # Nano's clock [ticks] at the end of the oldest of the newest pulses; None: no signal.
        self._pulse_ck: int | None = None
        self._steering = self._throttle = 0.0
        self._moved_at = -inf
        self._released = False

    def add(self, values: Mapping[str, Any], t: float) -> None:
        """Take over the message RC that arrived at host time ``t`` [s]."""
        self.pulses_us = tuple(TICK_US * pulse for pulse in values["pulse"])
        used = self.pulses_us[:self._channels]
        low, high = PULSE_RANGE
        if not all(low <= pulse <= high for pulse in used):
            self._pulse_ck = None
            return
        self._pulse_ck = values["t_ck"] - TICKS_PER_MS * max(values["age"][:self._channels])
        config = self._config
        self._steering = scale_stick(used[0], config.steering, config.dead_band_us)
        self._throttle = scale_stick(used[1], config.throttle, config.dead_band_us)
        if self._steering or self._throttle:
            self._moved_at = t

    def has_signal(self, state_ck: int) -> bool:
        """Return whether a pulse of every channel was recent at a STATE, in the Nano's ticks.

        Both times are the Nano's, so that delays of the line do not count; without any message the
        link is stale. A message RC may be newer than the STATE: the age is then negative. A clock
        that has restarted gives an age out of the range.
        """
        if self._pulse_ck is None:
            return False
        age = (state_ck - self._pulse_ck + HALF_CLOCK) % (2 * HALF_CLOCK) - HALF_CLOCK
        return abs(age) <= MAX_PULSE_AGE * TICKS_PER_SECOND

    def step(self, now: float, state_ck: int, *, armed: bool) -> bool:
        """Advance to the STATE of ``state_ck`` [ticks], which arrived at host time ``now`` [s].

        Returns whether the signal was lost during an override.
        """
        if not self.has_signal(state_ck):
            # Only another message counts again: the clock wraps after 36 minutes.
            self._pulse_ck = None
            ends = self.active
            self.lost = self.lost or ends
            self.active = self._released = False
            self._moved_at = -inf
            return ends
        self.lost = False
        self.active = (self._moved_at > now - RELEASE_TIME if self._config.mode_us is None
                       else self._switch_is_on())
        self._released = armed and (self._released or self._throttle == 0.0)
        return False

    def _switch_is_on(self) -> bool:
        threshold = self._config.mode_us
        return (self.pulses_us is not None and threshold is not None
                and self.pulses_us[2] > threshold)

    def command(self, now: float) -> SourceCommand | None:
        """Return the driver's command while he overrides the program, else None."""
        if not self.active:
            return None
        return SourceCommand(self._steering * self._max_steering,
                             self._throttle if self._released else 0.0,
                             now + MAX_PULSE_AGE, RC_SOURCE)
