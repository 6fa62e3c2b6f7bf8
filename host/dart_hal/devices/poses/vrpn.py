"""VRPN tracker messages, as servers of Vicon and OptiTrack send: bytes in, bodies out; no I/O.

Layout: vrpn_Connection and vrpn_Tracker of the VRPN library 07.x. Tested on bytes
built by it, which a client of VRPN 07.38 reads the same; not with a real server.
Big-endian. Both sides begin with a cookie of 24 bytes; then come messages of a
header of 24 bytes (length without padding, s, us, sender, type, sequence
number) and a payload padded to 8.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from dart_hal.devices.poses.rigid import Body

COOKIE = b"vrpn: ver. 07.35  0".ljust(24, b"\0")
"""Of this version; the 0 says that nothing is to be logged for us."""
POSE = "vrpn_Tracker Pos_Quat"
_MAGIC = b"vrpn: ver. 07."
_HEADER = struct.Struct(">IIIiiI")
_SENDER, _TYPE = -1, -2
_POSE = struct.Struct(">ii3d4d")
LONGEST = 65536
"""Bytes of a message that is believed; poses have 88."""


class Tracked(NamedTuple):
    """A pose: t [s] of the server's clock; sensor: which of the tracker's bodies."""

    body: Body
    t: float
    sensor: int


class Parser:
    """The stream of one connection. ``senders``: names that the server has told."""

    def __init__(self) -> None:
        self.senders: dict[int, str] = {}
        self.met = False
        self._types: dict[int, str] = {}
        self._rest = b""

    def feed(self, data: bytes) -> list[Tracked]:
        """Poses of the messages that are whole now.

        Raises ValueError for bytes that are not VRPN: the connection is lost.
        """
        self._rest += data
        if not self.met:
            if not self._rest.startswith(_MAGIC[:len(self._rest)]):
                raise ValueError(f"begins with {self._rest[:16]!r}, not {_MAGIC!r}")
            if len(self._rest) < len(COOKIE):
                return []
            self._rest, self.met = self._rest[len(COOKIE):], True
        out, at = [], 0
        while len(self._rest) - at >= _HEADER.size:
            length, s, us, sender, kind, _ = _HEADER.unpack_from(self._rest, at)
            if not _HEADER.size <= length <= LONGEST:
                raise ValueError(f"a VRPN message of {length} bytes")
            end = at + -(-length // 8) * 8
            if end > len(self._rest):
                break
            payload = self._rest[at + _HEADER.size:at + length]
            if kind == _SENDER:
                self.senders[sender] = _name(payload)
            elif kind == _TYPE:
                self._types[sender] = _name(payload)
            elif self._types.get(kind) == POSE:
                out.append(self._pose(sender, s + us * 1e-6, payload))
            at = end
        self._rest = self._rest[at:]
        return out

    def _pose(self, sender: int, t: float, payload: bytes) -> Tracked:
        if len(payload) != _POSE.size:
            raise ValueError(f"a pose of {len(payload)} bytes instead of {_POSE.size}")
        sensor, _, *numbers = _POSE.unpack(payload)
        name = self.senders.get(sender, str(sender))
        return Tracked(Body(name, tuple(numbers[:3]), tuple(numbers[3:])), t, sensor)


def _name(payload: bytes) -> str:
    """Of a description: its length with the final 0, u32, then the characters."""
    if len(payload) < 5 or int.from_bytes(payload[:4], "big") != len(payload) - 4:
        raise ValueError("a description whose length is not its own")
    return payload[4:].partition(b"\0")[0].decode("utf-8", "replace")
