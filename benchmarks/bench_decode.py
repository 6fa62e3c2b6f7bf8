"""How fast frames are decoded, next to the byte loop that one writes first.

All ways decode the same drive in one run on one core; each figure is the best
of a few rounds, because other work on the machine only ever slows one down.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from figures import Figure, best_cpu

from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import BY_ID

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "wire"))
import wire_samples as samples

ROUNDS = 5


class Row(NamedTuple):
    """One way: frames per second, what it must reach (0: nothing), one sentence."""

    name: str
    frames_per_s: float
    target: float
    what: str


def draw_frames(seconds: float) -> list[bytes]:
    """The frames of a drive of so many seconds."""
    return samples.drive(seconds, seed=1)


def run(seconds: float = 200.0) -> list[Row]:
    """Decode a drive of so many seconds in every way; the rows of the table."""
    frames = draw_frames(seconds)
    stream, count = b"".join(frames), len(frames)

    def row(name: str, target: float, what: str, decode: Callable[[], int], n: int) -> Row:
        return Row(name, n / _best(decode, n), target, what)

    return [
        row("byte loop", 0, "one byte at a time, bitwise CRC",
            lambda: decode_bytewise(b"".join(frames[:2000])), 2000),
        row("live, one read per frame", 150e3, "Decoder, values unpacked",
            lambda: decode_live(frames), count),
        row("live, reads of 4096 B", 150e3, "Decoder, values unpacked",
            lambda: decode_live([stream[i:i + 4096] for i in range(0, len(stream), 4096)]), count),
    ]


def figures(scale: float = 1.0) -> list[Figure]:
    """The same rows for the table of all figures, next to the byte loop."""
    rows = run(200.0 * max(scale, 0.1))
    naive = rows[0].frames_per_s
    return [Figure(f"decode: {row.name}", row.frames_per_s, "frames/s", row.target or None,
                   note=row.what + (f"; {row.frames_per_s / naive:.0f} x the byte loop"
                                    if row.target else ""))
            for row in rows]


def _best(decode: Callable[[], int], expected: int) -> float:
    def checked() -> None:
        got = decode()
        if got != expected:
            raise AssertionError(f"{got} frames of {expected}")

    return best_cpu(checked, ROUNDS)


def decode_live(reads: list[bytes]) -> int:
    """Return the number of frames in so many reads, with their values unpacked."""
    decoder, count = FrameDecoder(UP), 0
    for read in reads:
        for frame in decoder.feed(read):
            frame.values()
            count += 1
    return count


def decode_bytewise(stream: bytes) -> int:
    """The decoder that one writes first."""
    count, raw, left, code = 0, bytearray(), 0, 0xFF
    for byte in stream:
        if byte == 0:
            count += _accept(raw)
            raw, left, code = bytearray(), 0, 0xFF
        elif left:
            raw.append(byte)
            left -= 1
        else:
            if code != 0xFF:
                raw.append(0)
            code, left = byte, byte - 1
    return count


def _accept(raw: bytearray) -> bool:
    message = BY_ID.get(raw[0]) if len(raw) > 4 else None
    if message is None:
        return False
    crc = message.seed
    for byte in raw[:-2]:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    if crc != raw[-2] | raw[-1] << 8:
        return False
    if not message.variable:
        struct.unpack(message.struct.format, raw[2:-2])
    return True


def main() -> None:
    """Print the table."""
    print(f"{'decoder':<26}{'frames/s':>12}{'us/frame':>10}{'target':>12}")
    for row in run():
        target = f"{row.target:,.0f}" if row.target else "-"
        print(f"{row.name:<26}{row.frames_per_s:>12,.0f}{1e6 / row.frames_per_s:>10.2f}"
              f"{target:>12}  {row.what}")


if __name__ == "__main__":
    main()
