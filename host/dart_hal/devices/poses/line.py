"""The line protocol: one pose as one line of text in a datagram, from any program.

    dart-hal-pose 1 BODY FRAME t x y yaw [std_xy std_yaw]

Numbers are decimal, in s, m and rad, yaw counter-clockwise from the x axis of FRAME,
z up; BODY and FRAME are names without spaces. ``t`` is the time of the measurement
on any clock that does not jump. std: one sigma of x and y, and of yaw.
"""

from __future__ import annotations

from dart_hal.devices.poses.reading import PoseReading

MAGIC = "dart-hal-pose"
VERSION = "1"
# A longer line is not a pose.
MAX_LINE_BYTES = 300


def parse(data: bytes) -> list[PoseReading]:
    """Parse the poses of a datagram, one per line. Raises ValueError with the reason."""
    lines = [line for line in data.split(b"\n") if line.strip()]
    if not lines:
        raise ValueError("an empty datagram")
    return [_line(line) for line in lines]


def _line(line: bytes) -> PoseReading:
    if len(line) > MAX_LINE_BYTES:
        raise ValueError(f"a line of {len(line)} bytes")
    words = line.decode("ascii").split()
    if words[:2] != [MAGIC, VERSION]:
        raise ValueError(f"begins with {' '.join(words[:2])!r}, not {MAGIC} {VERSION}")
    if len(words) not in (8, 10):
        raise ValueError(f"{len(words)} words instead of 8 or 10")
    body, frame = words[2:4]
    return PoseReading(body, frame, *(_number(word) for word in words[4:]))


def _number(word: str) -> float:
    """Parse a decimal number. Raises ValueError, also for nan, inf and Python's 1_000."""
    if word.lower().lstrip("+-")[:1] not in "0123456789.":
        raise ValueError(f"{word!r} is not a number")
    return float(word.replace("_", "x"))


def line(reading: PoseReading) -> bytes:
    """Format one pose as a line that ``parse`` reads, with a newline."""
    r = reading
    numbers = " ".join(repr(float(v)) for v in (r.t, r.x, r.y, r.yaw, r.std, r.yaw_std))
    return f"{MAGIC} {VERSION} {r.body} {r.frame} {numbers}\n".encode("ascii")
