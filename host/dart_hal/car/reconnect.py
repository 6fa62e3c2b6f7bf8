"""The board that was unplugged, found again by its number, whatever its port is called now.

Ports that could be it are opened and listened to, all at once and without
waiting for any: a board that has just got power says HELLO by itself after its
boot loader (1.33 s). One that says another number is closed and left alone for
as long as it stays plugged in.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from dart_hal.car.handshake import ASK, ASK_EVERY, LISTEN, Port
from dart_hal.core.errors import DartHalError
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.serial_port import SerialLink

LOOK_EVERY = 0.25
"""s between two looks at what is plugged in; with the boot loader found within 2 s."""
SILENT_FOR = 5.0
"""s until a port that did not answer is asked again."""


class Found(NamedTuple):
    """An open link to the board, and what it has said so far."""

    link: SerialLink
    said: bytes


class Search:
    """Looks for the board ``board_id`` on the candidates of ``backend``; close it in the end."""

    def __init__(self, backend: Backend, board_id: int, baud: int) -> None:
        self._backend, self._board_id, self._baud = backend, board_id, baud
        self._calls: dict[str, _Call] = {}
        self._not_before: dict[str, float] = {}
        self._next = -inf

    def look(self, now: float) -> Found | None:
        """One step, at host time ``now`` [s], that waits for nothing."""
        if now >= self._next:
            self._next = now + LOOK_EVERY
            self._open(self._backend.candidates(), now)
        for device, call in list(self._calls.items()):
            try:
                answer = call.step(now)
            except DartHalError:  # gone again, or never ours
                self._drop(device, now)
                continue
            if answer == self._board_id:
                del self._calls[device]
                return Found(call.link, bytes(call.port.heard))
            if answer is not None:
                self._drop(device, inf)
            elif now > call.since + LISTEN + ASK:
                self._drop(device, now + SILENT_FOR)
        return None

    def close(self) -> None:
        """Let go of the ports that are being listened to."""
        for device in list(self._calls):
            self._drop(device, inf)

    def _open(self, devices: list[str], now: float) -> None:
        self._not_before = {d: t for d, t in self._not_before.items() if d in devices}
        for device in devices:
            if device in self._calls or now < self._not_before.get(device, -inf):
                continue
            try:
                link = SerialLink(device, self._baud)
            except DartHalError:  # busy, or not yet ours to open: at the next look
                continue
            self._calls[device] = _Call(link, now)

    def _drop(self, device: str, until: float) -> None:
        self._calls.pop(device).link.close()
        self._not_before[device] = until


class _Call:
    """One port that is listened to, later asked."""

    def __init__(self, link: SerialLink, now: float) -> None:
        self.link, self.port, self.since = link, Port(link), now
        self._ask_at = now + LISTEN

    def step(self, now: float) -> int | None:
        """The number of the board that answers there; None = nothing yet. Raises LinkLost."""
        if now >= self._ask_at:
            self._ask_at = now + ASK_EVERY
            self.port.ask()
        hello = self.port.poll(0.0)
        return hello.board_id if hello else None
