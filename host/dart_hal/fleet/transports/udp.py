"""``udp://ADDRESS:PORT``: a multicast group, or a list of addresses; the standard library alone.

    udp://239.255.42.99:7447                       all members of the group
    udp://:7447?to=10.0.0.11:7447,10.0.0.12:7447   listens at 7447, sends to each address

``via``: address of the network interface for multicast; ``hops``: routers that it may pass, 0 by
default: it stays in its network.
"""

from __future__ import annotations

import ipaddress
import socket
import threading
from collections.abc import Sequence
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.url import Url
from dart_hal.devices.poses.udp import Port, SharedPort
from dart_hal.fleet.transports import Datagram

EXPECTED = "udp://239.255.42.99:7447, or udp://:7447?to=10.0.0.11:7447,10.0.0.12:7447"
# Addresses beyond the list that are answered.
MAX_GUESTS = 64
# s for which one is answered after its last valid frame.
GUEST_TIMEOUT = 10.0

Address = tuple[str, int]


def open_udp(url: Url) -> UdpTransport:
    """Listen at a port and set the destinations. Raises UsageError, PortBusy, PortMissing."""
    url.known("to", "via", "hops")
    host, port = _address(url, url.target)
    group = bool(host) and _is_group(url, host)
    to = [_address(url, part) for part in url.options.get("to", "").split(",") if part]
    if group == bool(to):
        raise UsageError(f"{url.text} names no destination", found=url.text, expected=EXPECTED)
    hops = url.options.get("hops", "0")
    if not (hops.isascii() and hops.isdigit() and int(hops) < 255):
        raise UsageError(f"hops={hops!r} of a room", found=url.text, expected="0 to 254")
    if not group:
        return UdpTransport(url, SharedPort(Port(host, port, url.text)), to)
    via = url.options.get("via", "0.0.0.0")
    key = host, port, via, int(hops)
    with _doors:
        if key not in _groups or _groups[key].closed:
            _groups[key] = _open_group(url, *key)
        return UdpTransport(url, _groups[key], [(host, port)])


# Groups that cars of this process have joined: one socket for all of them, not a copy of every
# frame for each.
_groups: dict[tuple[str, int, str, int], SharedPort] = {}
_doors = threading.Lock()


def _open_group(url: Url, group: str, port: int, via: str, hops: int) -> SharedPort:
    """Open a port of the group. Raises UsageError and the errors of opening it."""
    listening = Port("", port, url.text, shared=True)
    try:
        _join(listening.socket, group, via, hops + 1)
    except OSError as why:
        listening.close()
        raise UsageError(f"{url.text}: cannot join the group", found=str(why),
                         expected="a network interface that does multicast",
                         remedy="via=ADDRESS of this computer, or a list: " + EXPECTED) from why
    return SharedPort(listening)


class UdpTransport:
    """A socket, and the destination addresses."""

    def __init__(self, url: Url, shared: SharedPort, addresses: Sequence[Address]) -> None:
        self.url = url.text
        self.trouble = ""
        self._port = shared.port
        self._reader = shared.reader()
        self._to = tuple(addresses)
        self._group = _is_group(url, addresses[0][0])
        self._guests: dict[Address, float] = {}

    @property
    def number(self) -> int:
        """Number of the local port."""
        return self._port.number

    def stamp(self, now: float) -> float:
        """Return the monotonic clock of the computer."""
        return elapsed()

    def send(self, data: bytes, now: float) -> None:
        self.trouble = ""
        for address in (*self._to, *self._guests):
            try:
                self._port.socket.sendto(data, address)
            except OSError as why:  # no network yet, a full queue: the next one comes in 50 ms
                self.trouble = f"{address[0]}:{address[1]}: {why}"
        if self._guests:
            old = elapsed() - GUEST_TIMEOUT
            self._guests = {a: t for a, t in self._guests.items() if t > old}

    def poll(self, now: float) -> Sequence[Datagram]:
        return [Datagram(*came) for came in self._reader.receive()]

    def answer(self, source: Any) -> None:
        if not self._group and source not in self._to and (
                source in self._guests or len(self._guests) < MAX_GUESTS):
            self._guests[source] = elapsed()

    def close(self) -> None:
        with _doors:
            self._reader.close()


def _address(url: Url, text: str) -> Address:
    host, _, port = text.rstrip("/").rpartition(":")
    if not (port.isascii() and port.isdigit() and int(port) < 65536):
        raise UsageError(f"{text!r} names no port", found=url.text, expected=EXPECTED)
    return host, int(port)


def _is_group(url: Url, host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_multicast
    except ValueError:
        return False  # a name


def _join(socket_: socket.socket, group: str, via: str, hops: int) -> None:
    member = socket.inet_aton(group) + socket.inet_aton(via)
    socket_.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    socket_.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, hops)
    if via != "0.0.0.0":
        socket_.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(via))
