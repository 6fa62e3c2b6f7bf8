"""Poses in datagrams: a socket that never blocks, and a parser of bytes.

On Linux the kernel stamps each datagram. Elsewhere its arrival is the time of the poll, up to 10 ms
late; the pose filter uses the earliest arrivals.
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from dart_hal.core.errors import PortBusy, PortDenied, PortMissing
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses.reading import Convention, PoseReading

Parse = Callable[[bytes], list[PoseReading]]

MAX_DATAGRAM = 65536
# Datagrams per poll: more of them must not delay the car.
MAX_POLL_DATAGRAMS = 256
# Datagrams that wait for each reader of a shared port: 20 s at 200 Hz.
MAX_WAITING_DATAGRAMS = 4096
_SO_TIMESTAMPNS = 35 if sys.platform == "linux" else 0
_TIMESPEC = struct.Struct("@qq")
# s; an older stamp means that the clock of the computer was set meanwhile.
_MAX_AGE = 1.0


class Datagrams(Protocol):
    """A source of datagrams."""

    @property
    def number(self) -> int:
        """Number of the UDP port."""

    def read(self) -> list[tuple[bytes, float]]:
        """Return (bytes, age [s]) of the datagrams that have arrived; never blocks."""

    def close(self) -> None: ...


class Port:
    """A UDP port; with ``shared``, other programs may receive the same multicast.

    Raises PortDenied, PortBusy, PortMissing, with ``name`` in the message.
    """

    def __init__(self, host: str, port: int, name: str, *, shared: bool = False) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if shared:
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.socket.bind((host, port))
            self.socket.setblocking(False)
            if _SO_TIMESTAMPNS:
                self.socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        except OSError as why:
            self.socket.close()
            raise _bind_error(why, name) from why

    @property
    def number(self) -> int:
        """Number of the UDP port."""
        return int(self.socket.getsockname()[1])

    def read(self) -> list[tuple[bytes, float]]:
        """Return the next datagrams, as ``Datagrams``, at most ``MAX_POLL_DATAGRAMS``."""
        return [(data, age) for data, age, _ in self.receive()]

    def receive(self) -> list[tuple[bytes, float, Any]]:
        """Return (bytes, age [s], address of the sender) of the next datagrams."""
        out: list[tuple[bytes, float, Any]] = []
        # One time for all: otherwise the duration of reading would change their order.
        now = time.time_ns()
        for _ in range(MAX_POLL_DATAGRAMS):
            try:
                data, ancillary, _, address = self.socket.recvmsg(MAX_DATAGRAM, 64)
            except (BlockingIOError, ConnectionError):
                break
            out.append((data, _age(ancillary, now), address))
        return out

    def close(self) -> None:
        self.socket.close()


class SharedPort:
    """One port for several readers that all receive every datagram; ``closed`` by the last."""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.closed = False
        self._readers: list[SharedReader] = []

    def reader(self) -> SharedReader:
        """Add a reader."""
        self._readers.append(SharedReader(self))
        return self._readers[-1]

    def take(self) -> None:
        """Pass the datagrams that have arrived to every reader."""
        received = elapsed()
        for data, age, address in self.port.receive():
            for reader in self._readers:
                reader.waiting.append((data, received - age, address))

    def leave(self, reader: SharedReader) -> None:
        """Remove a reader; the last one closes the port."""
        if reader in self._readers:
            self._readers.remove(reader)
            if not self._readers:
                self.closed = True
                self.port.close()


class SharedReader:
    """One reader of a ``SharedPort``, with the datagrams that it has not read yet."""

    def __init__(self, shared: SharedPort) -> None:
        self._shared = shared
        self.waiting: deque[tuple[bytes, float, Any]] = deque(maxlen=MAX_WAITING_DATAGRAMS)

    @property
    def number(self) -> int:
        """Number of the UDP port."""
        return self._shared.port.number

    def read(self) -> list[tuple[bytes, float]]:
        """Return the next datagrams, as ``Datagrams``."""
        return [(data, age) for data, age, _ in self.receive()]

    def receive(self) -> list[tuple[bytes, float, Any]]:
        """Return the next datagrams, as ``Port.receive``."""
        self._shared.take()
        now = elapsed()
        count = min(len(self.waiting), MAX_POLL_DATAGRAMS)
        newest = [self.waiting.popleft() for _ in range(count)]
        return [(data, max(now - received, 0.0), address) for data, received, address in newest]

    def close(self) -> None:
        self._shared.leave(self)


class UdpSource:
    """Poses of one body in datagrams.

    ``refused``: datagrams without a valid pose; ``why``: reason for the last one; ``others``: names
    of other bodies that were received.
    """

    on_board = False
    map_std = 0.0

    def __init__(self, datagrams: Datagrams, parse: Parse, convention: Convention,
                 name: str) -> None:
        self.name = name
        self.refused = 0
        self.why = ""
        self.others: set[str] = set()
        self._parse = parse
        self._convention = convention
        self._body = convention.body
        self._datagrams = datagrams

    @property
    def port(self) -> int:
        """Number of the UDP port."""
        return self._datagrams.number

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the poses of the datagrams that have arrived, as ``PoseSource``."""
        out: list[ExternalPose] = []
        for data, age in self._datagrams.read():
            try:
                arrival = max(now - age, 0.0)
                out += [self._convention.read(r).to_external(arrival) for r in self._parse(data)
                        if self._is_selected(r)]
            except ValueError as why:
                self.refused += 1
                self.why = str(why)
        return sorted(out, key=lambda pose: pose.arrival)

    def _is_selected(self, reading: PoseReading) -> bool:
        """Return whether it is the car's body: the selected one, or the first one received."""
        self._body = self._body or reading.body
        if reading.body != self._body:
            self.others.add(reading.body)
        return reading.body == self._body

    def close(self) -> None:
        self._datagrams.close()


def _age(ancillary: list[tuple[int, int, bytes]], now: int) -> float:
    """Return the time [s] from the kernel's stamp of a datagram to ``now`` [ns]; 0 without it."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            age = (now - seconds * 10**9 - nanoseconds) * 1e-9
            return age if 0.0 <= age < _MAX_AGE else 0.0
    return 0.0


def _bind_error(why: OSError, name: str) -> Exception:
    """Convert the OSError of binding to an error of the catalogue."""
    if isinstance(why, PermissionError):
        return PortDenied(f"{name}: this user may not open the port", found=str(why),
                          likely="a port below 1024", remedy="a port from 1024 on")
    if why.errno == errno.EADDRINUSE:
        return PortBusy(f"{name}: the port is in use", found=str(why),
                        likely="another program uses it", remedy="another port, or end it")
    return PortMissing(f"{name}: the port cannot be opened", found=str(why),
                       likely="an address that this computer does not have",
                       remedy="udp://:5005 receives at every address")
