"""An RC receiver in the virtual world: one pulse per channel each period, one after the other."""

from __future__ import annotations

# Time [s], pin of the Nano, level.
PinInput = tuple[float, str, bool]
# Pins of steering, throttle and third channel.
RECEIVER_PINS = ("D10", "D11", "D12")
# s between two pulses of a channel.
RECEIVER_PERIOD = 0.02
# us of a stick at rest.
STICK_REST_US = 1500.0


class SimReceiver:
    """The receiver and the sticks of its transmitter.

    pulses_us: of steering, throttle and third channel, None: no pulse; changed by the test or the
    program that holds the transmitter. has_signal: False, no pulse of any channel begins.
    """

    def __init__(self, period: float = RECEIVER_PERIOD) -> None:
        self.pulses_us: list[float | None] = [STICK_REST_US, STICK_REST_US, None]
        self.has_signal = True
        self._period = period
        self._next = 0.0
        self._waiting: list[PinInput] = []

    def edges(self, start: float, end: float) -> list[PinInput]:
        """Return the changes of the pins from ``start`` to ``end`` [s], in order of time."""
        while self._next < end:
            t = max(self._next, start)
            for pin, pulse in zip(RECEIVER_PINS, self.pulses_us, strict=True):
                if pulse is not None and self.has_signal:
                    self._waiting += [(t, pin, True), (t + 1e-6 * pulse, pin, False)]
                    t += 1e-6 * pulse
            self._next += self._period
        due = [edge for edge in self._waiting if edge[0] < end]
        self._waiting = [edge for edge in self._waiting if edge[0] >= end]
        return due
