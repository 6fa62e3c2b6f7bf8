"""From host to Nano: numbered frames, and the messages that are sent on a schedule."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dart_hal.car.hooks import Hooks
from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.ports import Link
from dart_hal.core.types import Applied
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import (
    BEAT_MODES,
    BEAT_REQUESTS,
    HEARTBEAT,
    TIME_PING,
    TIME_PONG,
    Message,
)

# s between pings: 10 Hz for the first 3 s, then 2 Hz.
FAST_PING_INTERVAL = 0.1
SLOW_PING_INTERVAL = 0.5
FAST_PING_TIME = 3.0
# Pings that wait for an answer; beyond, the oldest are forgotten.
MAX_OPEN_PINGS = 16
# Range of the field host_us, which wraps.
HOST_US_RANGE = 1 << 32


class Transmitter:
    """Numbers and sends frames; remembers pings until they are answered."""

    def __init__(self, link: Link, hooks: Hooks, host_id: int, byte_time: float) -> None:
        self._link = link
        self._hooks = hooks
        self._host_id = host_id
        self.byte_time = byte_time
        self._seq = 0
        self._ping_id = 0
        self._pings: dict[int, float] = {}
        self._next_ping = float("-inf")
        self._slow_from: float | None = None
        self._requests = 0

    def set_link(self, link: Link) -> None:
        """Continue over another link; open pings get no answer."""
        self._link = link
        self._pings.clear()

    def request(self, name: str) -> None:
        """Request a message of the Nano by every later heartbeat: RC or BATTERY."""
        self._requests |= BEAT_REQUESTS[name]

    def send(self, message: Message, values: Mapping[str, Any], t: float) -> int:
        """Send one message at host time ``t`` [s]; return its sequence number."""
        seq = self._seq
        self._seq = (seq + 1) & 0xFF
        data = self._hooks.tx(encode(message, seq, values), t)
        if data:
            self._link.write(data)
        return seq

    def heartbeat(self, applied: Applied, mode: str, token: int, direction: int, t: float) -> None:
        """Send the Nano's supervisor a heartbeat: pulses of the PCA9685, and the mode."""
        self.send(HEARTBEAT, {
            "host_id": self._host_id, "throttle": _tenths(applied.throttle_us),
            "steering": _tenths(applied.steering_us), "arm_token": token,
            "mode": BEAT_MODES[mode], "flags": {0: 0, 1: 1, -1: 2}[direction] | self._requests}, t)

    def ping(self, t: float) -> None:
        """Send a TIME_PING if one is due."""
        if t < self._next_ping:
            return
        if self._slow_from is None:
            self._slow_from = t + FAST_PING_TIME
        self._next_ping = t + (FAST_PING_INTERVAL if t < self._slow_from else SLOW_PING_INTERVAL)
        self._ping_id = (self._ping_id + 1) & 0xFFFF
        self._pings[self._ping_id] = t
        while len(self._pings) > MAX_OPEN_PINGS:
            del self._pings[next(iter(self._pings))]
        self.send(TIME_PING, {"ping_id": self._ping_id,
                              "host_us": int(t * 1e6) % HOST_US_RANGE}, t)

    def pong(self, values: Mapping[str, Any], clock: ClockFit, t_arrival: float,
             sent: float | None = None) -> None:
        """Add an answered ping to the clock fit.

        sent: when the ping was sent [s], from a recording; None: as remembered. An answer to an
        unknown ping is ignored.
        """
        own = self._pings.pop(values["ping_id"], None)
        sent = own if sent is None else sent
        if sent is None:
            return
        # Round trip = transmission of both frames + time in the Nano (0.5 us ticks) + delays.
        wire = (TIME_PING.wire_size + TIME_PONG.wire_size) * self.byte_time
        elapsed = (values["tx_ck"] - values["rx_ck"]) % (1 << 32) * 0.5e-6
        clock.add_ping(sent, 0.0, elapsed, t_arrival, wire)


def _tenths(pulse_us: float) -> int:
    """Return a pulse [us] in tenths of a microsecond, as on the wire."""
    return min(max(round(pulse_us * 10), 0), 65535)
