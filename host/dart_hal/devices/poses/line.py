"""The line protocol: one pose as one line of text, for whoever can send a datagram.

    dart-hal-pose 1 BODY FRAME t x y yaw [std_xy std_yaw]

Numbers are decimal, in s, m and rad, yaw counter-clockwise from the x axis of FRAME,
z up; BODY and FRAME are names without spaces. ``t`` is the time of the measurement
on any clock that does not jump. std: one sigma of x and y, and of yaw.
"""

from __future__ import annotations

from dart_hal.devices.poses.reading import Reading

MAGIC, VERSION = "dart-hal-pose", "1"
LONGEST = 300
"""Bytes of a line; a longer one is no pose."""


def parse(data: bytes) -> list[Reading]:
    """The poses of a datagram, one a line. Raises ValueError, which says what is wrong."""
    lines = [line for line in data.split(b"\n") if line.strip()]
    if not lines:
        raise ValueError("an empty datagram")
    return [_line(line) for line in lines]


def _line(line: bytes) -> Reading:
    if len(line) > LONGEST:
        raise ValueError(f"a line of {len(line)} bytes")
    words = line.decode("ascii").split()
    if words[:2] != [MAGIC, VERSION]:
        raise ValueError(f"begins with {' '.join(words[:2])!r}, not {MAGIC} {VERSION}")
    if len(words) not in (8, 10):
        raise ValueError(f"{len(words)} words instead of 8 or 10")
    body, frame = words[2:4]
    return Reading(body, frame, *(_number(word) for word in words[4:]))


def _number(word: str) -> float:
    if word.lower().lstrip("+-")[:1] not in "0123456789.":  # no nan, inf
        raise ValueError(f"{word!r} is not a number")
    return float(word.replace("_", "x"))  # nor Python's 1_000


def line(reading: Reading) -> bytes:
    """Inverse of ``parse`` for one pose; ends with a newline."""
    r = reading
    numbers = " ".join(repr(float(v)) for v in (r.t, r.x, r.y, r.yaw, r.std, r.yaw_std))
    return f"{MAGIC} {VERSION} {r.body} {r.frame} {numbers}\n".encode("ascii")
