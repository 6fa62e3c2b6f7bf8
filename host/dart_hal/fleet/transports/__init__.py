"""Transports of the frames of a room: in this process, UDP, zenoh, or of another package.

A transport registers under the entry-point group ``dart_hal.transports`` by URL scheme; each
entry is a function ``open(url: Url) -> Transport``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from dart_hal.core.errors import UsageError
from dart_hal.core.plugins import attribute_errors, list_plugins, load_entry
from dart_hal.core.url import Url

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "dart_hal.transports"


class Datagram(NamedTuple):
    """Bytes received ``age`` s ago by the clock of ``stamp``; source: argument of ``answer``."""

    data: bytes
    age: float
    source: object = None


class Transport(Protocol):
    """Sends datagrams to all members of a room: delayed, duplicated or lost.

    ``url``: as it was opened; ``trouble``: why the last datagram could not be sent, "" = it was.
    Methods may be called by any thread, by one at a time.
    """

    url: str
    trouble: str

    def stamp(self, now: float) -> float:
        """Return the time [s] >= 0 of the clock of the transport; ``now``: that of the car.

        It differs between two computers by a constant only.
        """

    def send(self, data: bytes, now: float) -> None:
        """Send to all members; never blocks, never raises: see ``trouble``."""

    def poll(self, now: float) -> Sequence[Datagram]:
        """Return the datagrams received since the last call, in order; never blocks.

        The own datagrams may be among them.
        """

    def answer(self, source: object) -> None:
        """Send to the source of a valid frame as well: it is a member."""

    def close(self) -> None:
        """Close the sockets; idempotent."""


def transports() -> dict[str, EntryPoint]:
    """Return the URL schemes of all installed packages."""
    return list_plugins(GROUP)


def open_transport(text: str) -> Transport:
    """Open the transport of a URL. Raises UsageError, PluginFailed, errors of the transport."""
    known = transports()
    expected = ", ".join(f"{name}://" for name in sorted(known))
    if "://" not in text:
        raise UsageError(f"{text!r} is no room of cars", found="no scheme://", expected=expected,
                         remedy=ROOM_EXAMPLES)
    url = Url.parse(text)
    if url.scheme not in known:
        raise UsageError(f"no transport for {url.scheme}://", found=text, expected=expected,
                         remedy=ROOM_EXAMPLES)
    entry = known[url.scheme]
    opener = load_entry(entry)
    with attribute_errors(entry):
        opened: Transport = opener(url)
    return opened


ROOM_EXAMPLES = "udp://239.255.42.99:7447, or local:// for cars of one program"
