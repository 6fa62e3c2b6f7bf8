"""What a NatNet server sends, built by the layouts of the SDK's depacketisation samples."""

from __future__ import annotations

import struct
from math import cos, sin

TICKS = 10_000_000


def message(kind, payload):
    return struct.pack("<HH", kind, len(payload)) + payload


def server_info(version=(4, 1), port=1511, group=None, ticks=TICKS):
    return message(1, struct.pack("<256s4B4B", b"Motive", 3, 1, 0, 0, *version, 0, 0)
                   + struct.pack("<QHB4B", ticks, port, group is not None,
                                 *(map(int, group.split(".")) if group else (0, 0, 0, 0))))


def section(version, count, content):
    size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
    return struct.pack("<i", count) + size + content


def level(yaw):
    """Quaternion x, y, z, w of a turn about z."""
    return 0.0, 0.0, sin(yaw / 2), cos(yaw / 2)


def rigid(number, place, turned, tracked=True):
    return struct.pack("<i3f4ffH", number, *place, *turned, 1e-3, tracked)


def frame(version, bodies, number=7, t=12.5, exposed=3 * TICKS):
    """Bodies among a marker set, skeleton, labelled marker, force plate and device."""
    spot = struct.pack("<3f", 1.0, 2.0, 3.0)
    plate = struct.pack("<iiiffi", 9, 2, 2, 0.5, 0.5, 1) + struct.pack("<f", 4.0)
    parts = [struct.pack("<i", number),
             section(version, 1, b"car\0" + struct.pack("<i", 3) + 3 * spot),
             section(version, 2, 2 * spot),
             section(version, len(bodies), b"".join(bodies)),
             section(version, 1, struct.pack("<ii", 1, 2) + 2 * rigid(1, (0,) * 3, level(0)))]
    if version >= (4, 1):
        parts.append(section(version, 0, b""))
    labelled = struct.pack("<i3ffHf", 65537, 1.0, 2.0, 3.0, 0.02, 0, 0)
    parts += [section(version, 1, labelled),
              section(version, 1, plate), section(version, 1, plate),
              struct.pack("<IIdQQQ", 0, 0, t, exposed, exposed + 1, exposed + 2)]
    if version >= (4, 1):
        parts.append(struct.pack("<II", 0, 0))
    return message(7, b"".join([*parts, struct.pack("<Hi", 0, 0)]))


def models(version, names):
    """Rigid bodies by id, with a marker set before and, from 4.1 on, a camera behind them."""
    def described(kind, content):
        size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
        return struct.pack("<i", kind) + size + content

    def body(number, name):
        turn = struct.pack("<4f", *level(0)) if version >= (4, 2) else b""
        marks = b"one\0two\0" if version >= (4, 0) else b""
        return (name.encode() + b"\0" + struct.pack("<ii3f", number, -1, 0, 0, 0) + turn
                + struct.pack("<i6f2i", 2, *(0.1,) * 6, 1, 2) + marks)

    parts = [described(0, b"car\0" + struct.pack("<i", 1) + b"m1\0")]
    parts += [described(1, body(number, name)) for number, name in names.items()]
    if version >= (4, 1):
        parts.insert(1, described(5, b"camera\0" + struct.pack("<7f", *(0.0,) * 7)))
    return message(5, struct.pack("<i", len(parts)) + b"".join(parts))
