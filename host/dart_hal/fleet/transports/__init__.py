"""Who carries the frames of a room: in this process, UDP, zenoh, or a package of somebody else.

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
    """Bytes that came ``age`` s ago by the clock of ``stamp``; source: whom ``answer`` knows."""

    data: bytes
    age: float
    source: object = None


class Transport(Protocol):
    """Carries datagrams to everybody in a room, perhaps late, twice or not at all.

    ``url``: as it was opened; ``trouble``: why the last datagram could not be sent, "" = it was.
    Methods may be called by any thread, by one at a time.
    """

    url: str
    trouble: str

    def stamp(self, now: float) -> float:
        """Time [s] >= 0 on the line's clock, where ``now`` is the car's: what differs between
        two computers by a constant alone."""

    def send(self, data: bytes, now: float) -> None:
        """To everybody; never blocks, never raises: see ``trouble``."""

    def poll(self, now: float) -> Sequence[Datagram]:
        """What has come since the last call, in order of arrival; never blocks.

        The own datagrams may come back."""

    def answer(self, source: object) -> None:
        """Who sent a good frame is in the room: send to it as well."""

    def close(self) -> None:
        """Let go of sockets; idempotent."""


def transports() -> dict[str, EntryPoint]:
    """URL schemes that an installed package carries."""
    return list_plugins(GROUP)


def open_transport(text: str) -> Transport:
    """Open the transport of a URL. Raises UsageError, PluginFailed, errors of the transport."""
    known = transports()
    expected = ", ".join(f"{name}://" for name in sorted(known))
    if "://" not in text:
        raise UsageError(f"{text!r} is no room of cars", found="no scheme://", expected=expected,
                         remedy=ROOMS)
    url = Url.parse(text)
    if url.scheme not in known:
        raise UsageError(f"no transport for {url.scheme}://", found=text, expected=expected,
                         remedy=ROOMS)
    entry = known[url.scheme]
    opener = load_entry(entry)
    with attribute_errors(entry):
        opened: Transport = opener(url)
    return opened


ROOMS = "udp://239.255.42.99:7447, or local:// for cars of one program"
