"""Search for a board that was unplugged, by its number; its port may have another name.

All ports that may be the board are opened and read at once, without waiting for any. A board
that has just got power sends HELLO by itself after its bootloader (1.33 s). A port with another
board is closed, and ignored as long as it stays plugged in.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

from dart_hal.car.handshake import BOOT_SILENCE, REQUEST_INTERVAL, REQUEST_TIME, HelloPort
from dart_hal.core.errors import DartHalError
from dart_hal.devices.links.base import Backend

if TYPE_CHECKING:
    from dart_hal.devices.links.serial_port import SerialLink

# s between two scans of the ports; with the bootloader the board is found within 2 s.
SCAN_INTERVAL = 0.25
# s until a port that did not answer is tried again.
RETRY_TIME = 5.0


class FoundBoard(NamedTuple):
    """An open link to the board, and the bytes received from it so far."""

    link: SerialLink
    received: bytes


class BoardSearch:
    """Searches the candidates of ``backend`` for a board by its number; ``close`` it at the en"""

    def __init__(self, backend: Backend, board_id: int, baud: int) -> None:
        self._backend = backend
        self._board_id = board_id
        self._baud = baud
        self._candidates: dict[str, _PortCandidate] = {}
        self._not_before: dict[str, float] = {}
        self._next = -inf

    def look(self, now: float) -> FoundBoard | None:
        """Run one step of the search at host time ``now`` [s]; it does not wait."""
        if now >= self._next:
            self._next = now + SCAN_INTERVAL
            self._open(self._backend.candidates(), now)
        # Read each candidate; keep those that have not answered yet.
        for device, candidate in list(self._candidates.items()):
            try:
                answer = candidate.step(now)
            except DartHalError:  # gone again, or never ours
                self._drop(device, now)
                continue
            if answer == self._board_id:
                del self._candidates[device]
                return FoundBoard(candidate.link, bytes(candidate.port.received))
            if answer is not None:
                self._drop(device, inf)
            elif now > candidate.since + BOOT_SILENCE + REQUEST_TIME:
                self._drop(device, now + RETRY_TIME)
        return None

    def close(self) -> None:
        """Close the ports that are open for the search."""
        for device in list(self._candidates):
            self._drop(device, inf)

    def _open(self, devices: list[str], now: float) -> None:
        """Open the ports that are new, or due to be tried again."""
        from dart_hal.devices.links.serial_port import SerialLink

        self._not_before = {d: t for d, t in self._not_before.items() if d in devices}
        for device in devices:
            if device in self._candidates or now < self._not_before.get(device, -inf):
                continue
            try:
                link = SerialLink(device, self._baud)
            except DartHalError:  # busy, or not yet ours to open: at the next look
                continue
            self._candidates[device] = _PortCandidate(link, now)

    def _drop(self, device: str, until: float) -> None:
        """Close a port, and ignore it until the time ``until`` [s]."""
        self._candidates.pop(device).link.close()
        self._not_before[device] = until


class _PortCandidate:
    """One port that is read; after the bootloader's time it gets requests."""

    def __init__(self, link: SerialLink, now: float) -> None:
        self.link = link
        self.port = HelloPort(link)
        self.since = now
        self._request_at = now + BOOT_SILENCE

    def step(self, now: float) -> int | None:
        """Return the number of the board that answers; None: no answer yet. Raises LinkLost."""
        if now >= self._request_at:
            self._request_at = now + REQUEST_INTERVAL
            self.port.request_hello()
        hello = self.port.poll(0.0)
        return hello.board_id if hello else None
