"""Bytes of a YDLidar X4: its packets, the answers to commands, the commands. No I/O.

A packet (X4 development manual; words little-endian):

    AA 55 | CT | LSN | FSA FSA | LSA LSA | CS CS | S1 S1 | ... | Sn Sn
    head   type  n     angles, first, last  check   n samples

CT: bit 0 is set in the packet that begins a revolution (one sample, its zero), which
also tells the revolutions in 0.1 Hz in bits 7 to 1, 0 where the firmware does not. CS
is the exclusive or of all other words: head, FSA, each sample, CT with LSN, LSA. A
sample is a quarter of a mm, 0 when nothing came back. An angle is 1/64 deg in bits 15
to 1, bit 0 is always set; the samples of a packet are equally far apart from FSA to
LSA, across 360 deg as well. The laser sits beside the receiver, so a point at d mm
lies atan(21.8 (155.3 - d) / (155.3 d)) further than the unit points.

The X4 begins to stream at ``START`` and answers it; the X4 Pro streams by itself and
answers nothing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

BAUD = 128_000
"""bit/s of an X4."""
PERIOD = 0.2e-3
"""s between two samples of the X4, by its own clock: 5 kHz."""
START, STOP, INFO, HEALTH = b"\xa5\x60", b"\xa5\x65", b"\xa5\x90", b"\xa5\x91"
"""Commands: stream, stop, who are you, how are you."""

HEAD = 10
"""Bytes of a packet before its samples."""
QUARTER = 0.25e-3
"""m of one count of a sample."""
UNIT = radians(1.0 / 64.0)
"""rad of one count of an angle."""
BASE, CROSSING = 21.8, 155.3
"""mm: the laser starts that far beside the receiver's axis and meets it that far ahead."""
_MARK = re.compile(rb"\xaa\x55|\xa5\x5a")
_ANSWER = 7
"""Bytes of an answer before its content: A5 5A, 30 bits of length with 2 of mode, type."""
_CONTENT = {0x04: 20, 0x06: 3, 0x81: 0}
"""Bytes of content by type: information, health; 0x81: packets follow."""


class Packet(NamedTuple):
    """Some beams in a row, n of them.

    starts: a revolution begins; hertz: what the unit tells of its revolutions, None =
    nothing; first, last [rad]: where the unit pointed, 0 to 2 pi; angle (n,) [rad] of the
    points, as the unit counts; distance (n,) [m, NaN = nothing came back]; size: bytes;
    behind: bytes that came after it in the same read.
    """

    starts: bool
    hertz: float | None
    first: float
    last: float
    angle: FloatArray
    distance: FloatArray
    size: int
    behind: int


@dataclass(frozen=True, slots=True)
class Answer:
    """What the unit says to a command: 0x04 information, 0x06 health, 0x81 it streams."""

    kind: int
    content: bytes

    def text(self) -> str:
        """In words."""
        c = self.content
        if self.kind == 0x04:
            return (f"model {c[0]}, firmware {c[2]}.{c[1]}, hardware {c[3]}, serial number "
                    + "".join(str(digit) for digit in c[4:]))
        if self.kind == 0x06:
            return "health good" if c[0] == 0 else f"health {c[0]}, error {c[1] | c[2] << 8}"
        return "it streams"


class Decoder:
    """Packets and answers out of any bytes, in any portions; raises nothing.

    packets, broken: those that were whole, and heads whose check or form is wrong;
    skipped: bytes that belong to neither; answers: the newest of each kind.
    """

    def __init__(self) -> None:
        self.packets = self.broken = self.skipped = 0
        self.answers: dict[int, Answer] = {}
        self._rest = b""

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that ``data`` completes."""
        held, at = self._rest + data, 0
        out: list[Packet] = []
        while (mark := _MARK.search(held, at)) is not None:
            self.skipped += mark.start() - at
            at = mark.start()
            length = _length(held, at)
            if length is None or (length and at + length > len(held)):
                self._rest = held[at:]
                return out
            if length and held[at] == 0xA5:
                answer = Answer(held[at + 6], held[at + _ANSWER:at + length])
                self.answers[answer.kind] = answer
            elif length and _whole(held[at:at + length]):
                self.packets += 1
                out.append(_packet(held[at:at + length], len(held) - at - length))
            else:
                self.broken += 1
                self.skipped += 2
                length = 2
            at += length
        keep = len(held) - (held[-1:] in (b"\xaa", b"\xa5") and at < len(held))
        self.skipped += keep - at
        self._rest = held[keep:]
        return out


def _length(held: bytes, at: int) -> int | None:
    """Bytes of what begins at ``at``: 0 = nothing can, None = too few to tell."""
    if held[at] == 0xAA:
        if at + 4 > len(held):
            return None
        samples = held[at + 3]
        return HEAD + 2 * samples if samples else 0
    if at + _ANSWER > len(held):
        return None
    content = _CONTENT.get(held[at + 6])
    return 0 if content is None else _ANSWER + content


def _whole(raw: bytes) -> bool:
    """The check, without which nothing else counts, and the bits that are always set."""
    words = np.frombuffer(raw, "<u2")
    return bool(np.bitwise_xor.reduce(words) == 0 and words[2] & words[3] & 1)


def _packet(raw: bytes, behind: int) -> Packet:
    words = np.frombuffer(raw, "<u2")
    first, last = float(words[2] >> 1) * UNIT, float(words[3] >> 1) * UNIT
    counts = words[HEAD // 2:]
    turn = (last - first) % (2.0 * np.pi)
    pointed = first + turn * np.arange(len(counts)) / max(len(counts) - 1, 1)
    distance = np.where(counts == 0, np.nan, counts * QUARTER)
    told = raw[2] >> 1
    starts = bool(raw[2] & 1)
    return Packet(starts, told / 10.0 if starts and told else None, first, last,
                  pointed + parallax(distance), distance, len(raw), behind)


def parallax(distance: FloatArray) -> FloatArray:
    """How much further than the unit points a point lies [rad]; 0 where there is none [NaN m]."""
    d = 1e3 * distance
    seen: FloatArray = np.arctan(BASE * (CROSSING - d) / (CROSSING * d))
    return np.where(np.isnan(d), 0.0, seen)
