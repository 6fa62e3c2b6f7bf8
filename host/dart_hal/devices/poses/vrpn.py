"""Parser of VRPN tracker messages, as sent by servers of Vicon and OptiTrack; no I/O.

Layout: vrpn_Connection and vrpn_Tracker of the VRPN library 07.x. Tested on bytes built by it,
which a client of VRPN 07.38 reads the same; not with a real server. Big-endian. Both sides begin
with a cookie of 24 bytes. Messages follow, each with a header of 24 bytes (length without padding,
s, us, sender, type, sequence number) and a payload padded to a multiple of 8.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from dart_hal.devices.poses.rigid import RigidBody

# The cookie of this version; the 0 requests no logging.
COOKIE = b"vrpn: ver. 07.35  0".ljust(24, b"\0")
POSE_MESSAGE = "vrpn_Tracker Pos_Quat"
_MAGIC = b"vrpn: ver. 07."
_MESSAGE_HEADER = struct.Struct(">IIIiiI")
# Types of the messages that describe a sender and a type.
_SENDER = -1
_TYPE = -2
_POSE_PAYLOAD = struct.Struct(">ii3d4d")
# A longer message is invalid; poses have 88 bytes.
MAX_MESSAGE_BYTES = 65536


class TrackedPose(NamedTuple):
    """A pose: t [s] of the server's clock; sensor: which of the tracker's bodies."""

    body: RigidBody
    t: float
    sensor: int


class Parser:
    """Parser for the stream of one connection. ``senders``: names received, by number."""

    def __init__(self) -> None:
        self.senders: dict[int, str] = {}
        self.has_cookie = False
        self._types: dict[int, str] = {}
        self._rest = b""

    def feed(self, data: bytes) -> list[TrackedPose]:
        """Return the poses of the messages that ``data`` completes.

        Raises ValueError for bytes that are not VRPN; the connection must then be closed.
        """
        self._rest += data
        if not self.has_cookie:
            if not self._rest.startswith(_MAGIC[:len(self._rest)]):
                raise ValueError(f"begins with {self._rest[:16]!r}, not {_MAGIC!r}")
            if len(self._rest) < len(COOKIE):
                return []
            self._rest = self._rest[len(COOKIE):]
            self.has_cookie = True
        out = []
        start = 0
        while len(self._rest) - start >= _MESSAGE_HEADER.size:
            length, s, us, sender, kind, _ = _MESSAGE_HEADER.unpack_from(self._rest, start)
            if not _MESSAGE_HEADER.size <= length <= MAX_MESSAGE_BYTES:
                raise ValueError(f"a VRPN message of {length} bytes")
            end = start + -(-length // 8) * 8  # rounded up to a multiple of 8
            if end > len(self._rest):
                break
            payload = self._rest[start + _MESSAGE_HEADER.size:start + length]
            if kind == _SENDER:
                self.senders[sender] = _parse_name(payload)
            elif kind == _TYPE:
                self._types[sender] = _parse_name(payload)
            elif self._types.get(kind) == POSE_MESSAGE:
                out.append(self._parse_pose(sender, s + us * 1e-6, payload))
            start = end
        self._rest = self._rest[start:]
        return out

    def _parse_pose(self, sender: int, t: float, payload: bytes) -> TrackedPose:
        if len(payload) != _POSE_PAYLOAD.size:
            raise ValueError(f"a pose of {len(payload)} bytes instead of {_POSE_PAYLOAD.size}")
        sensor, _, *numbers = _POSE_PAYLOAD.unpack(payload)
        name = self.senders.get(sender, str(sender))
        return TrackedPose(RigidBody(name, tuple(numbers[:3]), tuple(numbers[3:])), t, sensor)


def _parse_name(payload: bytes) -> str:
    """Return the text of a description: its length with the final 0, u32, then the characters."""
    if len(payload) < 5 or int.from_bytes(payload[:4], "big") != len(payload) - 4:
        raise ValueError("a description with a wrong length")
    return payload[4:].partition(b"\0")[0].decode("utf-8", "replace")
