"""RC receiver and divider of the battery of MockNano, as the firmware's core measures them."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.devices.battery.divider import BAND_GAP_V
from dart_hal.wire.messages import TICKS_PER_SECOND
from dart_lab.sim.rc import RECEIVER_PINS

CK_PER_MS = TICKS_PER_SECOND // 1000
_MASK = 0xFFFFFFFF
# Constants of firmware/src/core/rc_receiver.h [ck].
SHORTEST_PULSE = 1600
LONGEST_PULSE = 4400
LEAST_PERIOD = 8 * CK_PER_MS
MOST_GAP = 100 * CK_PER_MS
GOOD_RUN = 5
# Slots between two BATTERY messages.
BATTERY_SLOTS = 12
# ohm of the pull-up of A0: 20 to 50 k by the data sheet.
PULL_UP = 35e3
FULL_SCALE = 1023


class _Channel:
    """One channel: its newest rise and good pulse [ck]."""

    def __init__(self, now: int) -> None:
        self.rise = self.good_at = now
        self.pulse = self.run = 0
        self.high = self.spaced = False


class MockReceiver:
    """Pulses of three channels; times in ck, levels as bits."""

    def __init__(self, now: int, levels: int = 0) -> None:
        self._channels = [_Channel(now) for _ in RECEIVER_PINS]
        self._levels = levels
        self._refused = 0

    def edge(self, stamp: int, levels: int) -> None:
        """Take over the levels of the pins since ``stamp``."""
        changed = levels ^ self._levels
        self._levels = levels
        for i, channel in enumerate(self._channels):
            if changed >> i & 1:
                if levels >> i & 1:
                    channel.spaced = (stamp - channel.rise) & _MASK >= LEAST_PERIOD
                    channel.rise = stamp
                    channel.high = True
                elif channel.high:
                    self._end_pulse(channel, stamp)

    def _end_pulse(self, channel: _Channel, stamp: int) -> None:
        channel.high = False
        width = (stamp - channel.rise) & _MASK
        if not (channel.spaced and SHORTEST_PULSE <= width <= LONGEST_PULSE):
            self._refused = (self._refused + 1) & 0xFF
            channel.run = GOOD_RUN if channel.run == GOOD_RUN else 0
            return
        if (stamp - channel.good_at) & _MASK > MOST_GAP:
            channel.run = 0
        channel.run = min(channel.run + 1, GOOD_RUN)
        channel.good_at = stamp
        channel.pulse = width

    def gap(self, now: int, levels: int) -> None:
        """Give up the pulses that have begun: edges were missed."""
        for channel in self._channels:
            channel.rise = now
            channel.high = False
        self._levels = levels
        self._refused = (self._refused + 1) & 0xFF

    def frame(self, now: int) -> tuple[int, ...]:
        """Return the values of RC."""
        pulses = []
        ages = []
        for channel in self._channels:
            age = (now - channel.good_at) & _MASK
            if age > MOST_GAP:
                channel.run = 0
                channel.good_at = (now - MOST_GAP - 1) & _MASK
            present = channel.run == GOOD_RUN
            pulses.append(channel.pulse if present else 0)
            ages.append(age // CK_PER_MS if present else 255)
        return (now, *pulses, *ages, self._refused)


def measure_divider(ck: int, volt: float | None, ohm: float, supply: float) -> Sequence[int]:
    """Return the values of BATTERY for a voltage [V] behind a resistance [ohm] at A0.

    volt None: nothing is connected; the pin then has any voltage, here half of the supply.
    """
    def convert(voltage: float) -> int:
        return min(max(int(FULL_SCALE * voltage / supply + 1e-9), 0), FULL_SCALE)

    pulled = supply if volt is None else (volt * PULL_UP + supply * ohm) / (PULL_UP + ohm)
    pin = 0.5 * supply if volt is None else volt
    return ck, 4 * convert(pin), 4 * convert(BAND_GAP_V), convert(pulled)
