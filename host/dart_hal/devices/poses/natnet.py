"""NatNet, the protocol of OptiTrack Motive, 3.0 to 4.x: bytes in, bodies out; no I/O.

Layouts: the depacketisation samples of OptiTrack's NatNet SDK ("PacketClient").
Written from them and tested on bytes built by them, not with a running Motive.
Little-endian. A message is id u16, length u16, payload. From 4.1 on each
section of a frame tells its size in bytes and need not be understood.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from dart_hal.devices.poses.rigid import Body

CONNECT, SERVER_INFO, REQUEST_MODELS, MODELS, FRAME, KEEP_ALIVE = 0, 1, 4, 5, 7, 10
SIZED = (4, 1)
OLDEST, NEWEST = (3, 0), (5, 0)
_TRACKED = 1
_HEAD = struct.Struct("<HH")
_BODY = struct.Struct("<i3f4ffH")
_SUFFIX = struct.Struct("<IIdQ")
_INFO = struct.Struct("<256s4B4B")
_CONNECTION = struct.Struct("<QHB4s")
_LABELLED = 26

Version = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Server:
    """Who answered: ``ticks`` per s of its clock (0: not told); ``group``: "" in unicast."""

    application: str
    version: Version
    ticks: int
    data_port: int
    group: str


@dataclass(frozen=True, slots=True)
class Frame:
    """Bodies that were tracked; ``lost``: ids of those that were not.

    t [s]: since Motive began; exposed: ticks of its clock at the middle of the
    exposure, 0 where the cameras do not tell. Bodies are named by their ids.
    """

    number: int
    t: float
    exposed: int
    bodies: tuple[Body, ...]
    lost: tuple[str, ...]


def request(kind: int, text: str = "") -> bytes:
    """A message to the server."""
    payload = text.encode("ascii") + b"\0" if text else b""
    return _HEAD.pack(kind, len(payload)) + payload


def message(data: bytes) -> tuple[int, bytes]:
    """(id, payload) of a datagram. Raises ValueError."""
    if len(data) < _HEAD.size:
        raise ValueError(f"{len(data)} bytes are no NatNet message")
    kind, size = _HEAD.unpack_from(data)
    if size > len(data) - _HEAD.size:
        raise ValueError(f"a NatNet message of {size} bytes, cut at {len(data) - _HEAD.size}")
    return kind, data[_HEAD.size:_HEAD.size + size]


def server(payload: bytes) -> Server:
    """The answer to CONNECT. Raises ValueError, also for a version that is not read here."""
    cursor = _Cursor(payload)
    name, *numbers = cursor.take(_INFO)
    version = (numbers[4], numbers[5])
    if not OLDEST <= version < NEWEST:
        raise ValueError(f"NatNet {version[0]}.{version[1]}; 3.0 to 4.x are read")
    ticks, port, multicast, group = cursor.take(_CONNECTION)
    return Server(name.partition(b"\0")[0].decode("utf-8", "replace"), version, ticks, port,
                  ".".join(map(str, group)) if multicast else "")


def models(payload: bytes, version: Version) -> dict[str, str]:
    """id -> name of the rigid bodies. Raises ValueError.

    Before 4.1 descriptions have no size: what follows the first one that is
    neither a marker set nor a rigid body is not read (Motive tells bodies first).
    """
    cursor, names = _Cursor(payload), {}
    for _ in range(cursor.count()):
        kind = cursor.integer()
        end = cursor.size() if version >= SIZED else None
        if kind == 0:
            cursor.text()
            for _ in range(cursor.count()):
                cursor.text()
        elif kind == 1:
            name = cursor.text()
            names[str(cursor.integer())] = name
            if end is None:
                cursor.skip(4 + 12)
                markers = cursor.count()
                cursor.skip(16 * markers)
                for _ in range(markers if version >= (4, 0) else 0):
                    cursor.text()
        elif end is None:
            break
        if end is not None:
            cursor.at = end
    return names


def frame(payload: bytes, version: Version) -> Frame:
    """A frame of mocap data. Raises ValueError."""
    cursor, sized = _Cursor(payload), version >= SIZED
    number = cursor.integer()
    if sized:
        cursor.section()  # marker sets
        cursor.section()  # unlabelled markers
    else:
        for _ in range(cursor.count()):
            cursor.text()
            cursor.skip(12 * cursor.count())
        cursor.skip(12 * cursor.count())
    bodies, lost = [], []
    several = cursor.count()
    end = cursor.size() if sized else None
    for _ in range(several):
        found = cursor.take(_BODY)
        name = str(found[0])
        if found[9] & _TRACKED:
            bodies.append(Body(name, found[1:4], found[4:8]))
        else:
            lost.append(name)
    if end is not None:
        cursor.at = end
    _beyond_bodies(cursor, sized)
    _, _, t, exposed = cursor.take(_SUFFIX)
    return Frame(number, t, exposed, tuple(bodies), tuple(lost))


def _beyond_bodies(cursor: _Cursor, sized: bool) -> None:
    """Skeletons, assets (4.1), labelled markers, force plates, devices."""
    if sized:
        for _ in range(5):
            cursor.section()
        return
    for _ in range(cursor.count()):
        cursor.skip(4)
        cursor.skip(_BODY.size * cursor.count())
    cursor.skip(_LABELLED * cursor.count())
    for _ in ("force plates", "devices"):
        for _ in range(cursor.count()):
            cursor.skip(4)
            for _ in range(cursor.count()):
                cursor.skip(4 * cursor.count())


class _Cursor:
    """Reads on from byte to byte; whatever does not fit raises ValueError."""

    def __init__(self, data: bytes) -> None:
        self._data, self.at = data, 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        start = self.at
        self.skip(layout.size)
        return layout.unpack_from(self._data, start)

    def skip(self, n: int) -> None:
        if not 0 <= n <= len(self._data) - self.at:
            raise ValueError(f"{n} bytes wanted of {len(self._data) - self.at}")
        self.at += n

    def integer(self) -> int:
        start = self.at
        self.skip(4)
        return int.from_bytes(self._data[start:self.at], "little", signed=True)

    def count(self) -> int:
        """A number of things, each of which has a byte at least."""
        n = self.integer()
        if not 0 <= n <= len(self._data):
            raise ValueError(f"a count of {n} in {len(self._data)} bytes")
        return n

    def size(self) -> int:
        """Where a section whose size in bytes stands here ends."""
        size = self.count()
        start = self.at
        self.skip(size)
        self.at = start
        return start + size

    def section(self) -> None:
        """Over a section of 4.1: count, size, bytes."""
        self.count()
        self.at = self.size()

    def text(self) -> str:
        end = self._data.find(b"\0", self.at)
        if end < 0:
            raise ValueError("a name without an end")
        start, self.at = self.at, end + 1
        return self._data[start:end].decode("utf-8", "replace")
