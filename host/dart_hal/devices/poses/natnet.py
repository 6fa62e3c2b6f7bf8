"""Parser of NatNet, the protocol of OptiTrack Motive, 3.0 to 4.x; no I/O.

Layouts: the depacketisation samples of OptiTrack's NatNet SDK ("PacketClient"). The parser follows
them and is tested on bytes built by them, not with a running Motive. Little-endian. A message is
id u16, length u16, payload. From 4.1 on each section of a frame contains its size in bytes, so
unknown sections can be skipped.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from dart_hal.devices.poses.rigid import RigidBody

# Ids of messages.
CONNECT = 0
SERVER_INFO = 1
REQUEST_MODELS = 4
MODELS_MESSAGE = 5
FRAME_MESSAGE = 7
KEEP_ALIVE = 10
# First version whose sections contain their size.
FIRST_SIZED_VERSION = (4, 1)
# Versions that are read, without the last one.
MIN_VERSION = (3, 0)
END_VERSION = (5, 0)
# Bit of a body's flags.
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
    """A server: ``ticks`` per s of its clock (0: unknown); ``group``: multicast, "" = unicast."""

    application: str
    version: Version
    ticks: int
    data_port: int
    group: str


@dataclass(frozen=True, slots=True)
class NatNetFrame:
    """A frame with the bodies that were tracked, named by ids; ``lost``: ids of the others.

    t [s]: since the start of Motive; exposed: ticks of its clock at the middle of the exposure, 0
    if the cameras do not send it.
    """

    number: int
    t: float
    exposed: int
    bodies: tuple[RigidBody, ...]
    lost: tuple[str, ...]


def request(kind: int, text: str = "") -> bytes:
    """Make a message to the server."""
    payload = text.encode("ascii") + b"\0" if text else b""
    return _HEAD.pack(kind, len(payload)) + payload


def message(data: bytes) -> tuple[int, bytes]:
    """Return (id, payload) of a datagram. Raises ValueError."""
    if len(data) < _HEAD.size:
        raise ValueError(f"{len(data)} bytes are no NatNet message")
    kind, size = _HEAD.unpack_from(data)
    if size > len(data) - _HEAD.size:
        raise ValueError(f"a NatNet message of {size} bytes, cut at {len(data) - _HEAD.size}")
    return kind, data[_HEAD.size:_HEAD.size + size]


def server(payload: bytes) -> Server:
    """Parse the answer to CONNECT. Raises ValueError, also for an unsupported version."""
    cursor = _Cursor(payload)
    name, *numbers = cursor.take(_INFO)
    version = (numbers[4], numbers[5])
    if not MIN_VERSION <= version < END_VERSION:
        raise ValueError(f"NatNet {version[0]}.{version[1]}; 3.0 to 4.x are read")
    ticks, port, multicast, group = cursor.take(_CONNECTION)
    return Server(name.partition(b"\0")[0].decode("utf-8", "replace"), version, ticks, port,
                  ".".join(map(str, group)) if multicast else "")


def models(payload: bytes, version: Version) -> dict[str, str]:
    """Parse the descriptions: id -> name of the rigid bodies. Raises ValueError.

    Before 4.1 descriptions have no size. Parsing then ends at the first one that is neither a
    marker set nor a rigid body (Motive sends bodies first).
    """
    cursor = _Cursor(payload)
    names: dict[str, str] = {}
    for _ in range(cursor.count()):
        kind = cursor.integer()
        end = cursor.size() if version >= FIRST_SIZED_VERSION else None
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
            cursor.position = end
    return names


def frame(payload: bytes, version: Version) -> NatNetFrame:
    """Parse a frame of motion-capture data. Raises ValueError."""
    cursor = _Cursor(payload)
    sized = version >= FIRST_SIZED_VERSION
    number = cursor.integer()
    if sized:
        cursor.section()  # marker sets
        cursor.section()  # unlabelled markers
    else:
        for _ in range(cursor.count()):
            cursor.text()
            cursor.skip(12 * cursor.count())
        cursor.skip(12 * cursor.count())
    bodies: list[RigidBody] = []
    lost: list[str] = []
    count = cursor.count()
    end = cursor.size() if sized else None
    for _ in range(count):
        found = cursor.take(_BODY)
        name = str(found[0])
        if found[9] & _TRACKED:
            bodies.append(RigidBody(name, found[1:4], found[4:8]))
        else:
            lost.append(name)
    if end is not None:
        cursor.position = end
    _skip_after_bodies(cursor, sized)
    _, _, t, exposed = cursor.take(_SUFFIX)
    return NatNetFrame(number, t, exposed, tuple(bodies), tuple(lost))


def _skip_after_bodies(cursor: _Cursor, sized: bool) -> None:
    """Skip skeletons, assets (4.1), labelled markers, force plates and devices."""
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
    """Reads values one after the other; raises ValueError beyond the end of the data."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Read the values of a layout."""
        start = self.position
        self.skip(layout.size)
        return layout.unpack_from(self._data, start)

    def skip(self, n: int) -> None:
        """Skip n bytes."""
        if not 0 <= n <= len(self._data) - self.position:
            raise ValueError(f"{n} bytes expected, {len(self._data) - self.position} left")
        self.position += n

    def integer(self) -> int:
        """Read an i32."""
        start = self.position
        self.skip(4)
        return int.from_bytes(self._data[start:self.position], "little", signed=True)

    def count(self) -> int:
        """Read a number of items, each of which has at least one byte."""
        n = self.integer()
        if not 0 <= n <= len(self._data):
            raise ValueError(f"a count of {n} in {len(self._data)} bytes")
        return n

    def size(self) -> int:
        """Read the size of a section in bytes; return the position of its end."""
        size = self.count()
        start = self.position
        self.skip(size)
        self.position = start
        return start + size

    def section(self) -> None:
        """Skip a section of 4.1: count, size, bytes."""
        self.count()
        self.position = self.size()

    def text(self) -> str:
        """Read a text that ends with a 0 byte."""
        end = self._data.find(b"\0", self.position)
        if end < 0:
            raise ValueError("a name without an end")
        start = self.position
        self.position = end + 1
        return self._data[start:end].decode("utf-8", "replace")
