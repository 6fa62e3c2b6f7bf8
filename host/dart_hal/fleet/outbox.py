"""Sending of frames by one member: numbered, and signed if the room has a key."""

from __future__ import annotations

from typing import Any

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.peers import Peers
from dart_hal.fleet.transports import Transport


class Outbox:
    """Sends frames of one member. Raises only UsageError, for invalid values."""

    def __init__(self, peers: Peers, transport: Transport) -> None:
        self._peers = peers
        self._transport = transport
        self._seq = 0

    def send(self, kind: m.Kind, values: tuple[Any, ...], now: float) -> None:
        """Send a frame to all members; ``values`` without the name, now [s] of the own clock."""
        self._seq += 1
        peers = self._peers
        line = self._transport
        data = encode(kind, peers.boot, self._seq, line.stamp(now), (peers.own, *values),
                      peers.decoder.key)
        peers.note_sent(self._seq, now)
        line.send(data, now)

    def send_heard(self, now: float) -> None:
        """Send the echoes that prove to the other members that this one is alive."""
        echoes = self._peers.echoes()
        if echoes:
            self.send(m.HEARD, (echoes,), now)
