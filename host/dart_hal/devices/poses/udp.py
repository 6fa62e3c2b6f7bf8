"""Poses that come as datagrams: a socket that never blocks, and a parser of bytes.

The kernel stamps each datagram (Linux); elsewhere its arrival is the time of
the poll, up to 10 ms late, which the earliest arrivals make good.
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
from dart_hal.devices.poses.reading import Convention, Reading

Parse = Callable[[bytes], list[Reading]]

LARGEST = 65536
AT_ONCE = 256
"""Datagrams of one poll; a flood must not hold up the car."""
KEPT = 4096
"""Datagrams that wait for a reader who shares a port: 20 s of 200 Hz."""
_SO_TIMESTAMPNS = 35 if sys.platform == "linux" else 0
_TIMESPEC = struct.Struct("@qq")
_MAX_AGE = 1.0
"""s; an older stamp means that the clock of the computer was set meanwhile."""


class Datagrams(Protocol):
    """Where datagrams come from."""

    @property
    def number(self) -> int:
        """The port that is listened at."""

    def read(self) -> list[tuple[bytes, float]]:
        """(bytes, age [s]) of those that have come; never blocks."""

    def close(self) -> None: ...


class Port:
    """A UDP port; with ``shared``, others may listen to the same multicast.

    Raises PortDenied, PortBusy, PortMissing, in the name of ``name``.
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
            raise _cannot(why, name) from why

    @property
    def number(self) -> int:
        """The port that is listened at."""
        return int(self.socket.getsockname()[1])

    def read(self) -> list[tuple[bytes, float]]:
        """As ``Datagrams``; at most ``AT_ONCE``."""
        return [(data, age) for data, age, _ in self.receive()]

    def receive(self) -> list[tuple[bytes, float, Any]]:
        """The same with the address of the sender."""
        out: list[tuple[bytes, float, Any]] = []
        now = time.time_ns()  # one for all: else the time that reading takes puts them out of order
        for _ in range(AT_ONCE):
            try:
                data, ancillary, _, address = self.socket.recvmsg(LARGEST, 64)
            except (BlockingIOError, ConnectionError):
                break
            out.append((data, _age(ancillary, now), address))
        return out

    def close(self) -> None:
        self.socket.close()


class SharedPort:
    """One port for several readers, each of whom sees every datagram; ``closed`` by the last."""

    def __init__(self, port: Port) -> None:
        self.port, self.closed = port, False
        self._readers: list[SharedReader] = []

    def reader(self) -> SharedReader:
        """One more."""
        self._readers.append(SharedReader(self))
        return self._readers[-1]

    def take(self) -> None:
        """Hand what has come to every reader."""
        received = elapsed()
        for data, age, address in self.port.receive():
            for reader in self._readers:
                reader.waiting.append((data, received - age, address))

    def leave(self, reader: SharedReader) -> None:
        """The last one closes the port."""
        if reader in self._readers:
            self._readers.remove(reader)
            if not self._readers:
                self.closed = True
                self.port.close()


class SharedReader:
    """What one reader of a ``SharedPort`` has not seen yet."""

    def __init__(self, shared: SharedPort) -> None:
        self._shared = shared
        self.waiting: deque[tuple[bytes, float, Any]] = deque(maxlen=KEPT)

    @property
    def number(self) -> int:
        """As ``Datagrams``."""
        return self._shared.port.number

    def read(self) -> list[tuple[bytes, float]]:
        """As ``Datagrams``."""
        return [(data, age) for data, age, _ in self.receive()]

    def receive(self) -> list[tuple[bytes, float, Any]]:
        """As ``Port.receive``."""
        self._shared.take()
        now, waiting = elapsed(), self.waiting
        came = [waiting.popleft() for _ in range(min(len(waiting), AT_ONCE))]
        return [(data, max(now - received, 0.0), address) for data, received, address in came]

    def close(self) -> None:
        self._shared.leave(self)


class UdpSource:
    """Poses of one body out of datagrams.

    ``refused``: datagrams without a usable pose; ``why``: what was wrong with
    the last one; ``others``: names of other bodies that were told.
    """

    on_board = False

    def __init__(self, datagrams: Datagrams, parse: Parse, convention: Convention,
                 name: str) -> None:
        self.name = name
        self.refused, self.why = 0, ""
        self.others: set[str] = set()
        self._parse, self._convention = parse, convention
        self._body = convention.body
        self._datagrams = datagrams

    @property
    def port(self) -> int:
        """The port that is listened at."""
        return self._datagrams.number

    def poll(self, now: float) -> list[ExternalPose]:
        """Poses of the datagrams that have come, as ``PoseSource``."""
        out: list[ExternalPose] = []
        for data, age in self._datagrams.read():
            try:
                arrival = max(now - age, 0.0)
                out += [self._convention.read(r).at(arrival) for r in self._parse(data)
                        if self._ours(r)]
            except ValueError as why:
                self.refused, self.why = self.refused + 1, str(why)
        return sorted(out, key=lambda pose: pose.arrival)

    def _ours(self, reading: Reading) -> bool:
        """The first body that is told is the car, unless one was named."""
        self._body = self._body or reading.body
        if reading.body != self._body:
            self.others.add(reading.body)
        return reading.body == self._body

    def close(self) -> None:
        self._datagrams.close()


def _age(ancillary: list[tuple[int, int, bytes]], now: int) -> float:
    """s from when the kernel received the datagram to ``now`` [ns]; 0 where it does not tell."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) >= _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack_from(data)
            age = (now - seconds * 10**9 - nanoseconds) * 1e-9
            return age if 0.0 <= age < _MAX_AGE else 0.0
    return 0.0


def _cannot(why: OSError, name: str) -> Exception:
    """The OSError of binding as an error of the catalogue."""
    if isinstance(why, PermissionError):
        return PortDenied(f"{name}: this user may not listen there", found=str(why),
                          likely="a port below 1024", remedy="a port from 1024 on")
    if why.errno == errno.EADDRINUSE:
        return PortBusy(f"{name}: the port is in use", found=str(why),
                        likely="another program listens there", remedy="another port, or end it")
    return PortMissing(f"{name}: cannot be listened at", found=str(why),
                       likely="an address that this computer does not have",
                       remedy="udp://:5005 listens at every address")
