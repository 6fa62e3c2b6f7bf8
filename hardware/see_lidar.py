"""Does the lidar turn and deliver? Listens to a YDLidar X4 for two seconds.

    python hardware/see_lidar.py                 the first CP2102 adapter (10c4:ea60)
    python hardware/see_lidar.py /dev/ttyUSB1

Exit code 0: it delivers, 1: it does not, 2: no such port. Protocol: YDLidar X4 development manual
[data sheet]; not tried on hardware yet.
"""

from __future__ import annotations

import math
import struct
import sys
import time
from dataclasses import dataclass

import serial
from serial.tools import list_ports

BAUD = 128_000
START, STOP = b"\xa5\x60", b"\xa5\x65"
HEADER = b"\xaa\x55"
SECONDS = 2.0
AHEAD = math.radians(5.0)
"""Half of the sector that counts as straight ahead."""


@dataclass(frozen=True)
class Packet:
    """``first``: begins a turn. ``angles`` [rad], ``ranges`` [m]; 0 m = nothing seen."""

    first: bool
    angles: tuple[float, ...]
    ranges: tuple[float, ...]


def packets(data: bytes) -> list[Packet]:
    """Every whole packet with a right check sum in a stretch of bytes."""
    found, at = [], data.find(HEADER)
    while at >= 0 and at + 10 <= len(data):
        kind, count, first, last, told = struct.unpack_from("<BBHHH", data, at + 2)
        end = at + 10 + 2 * count
        if end > len(data):
            break
        samples = struct.unpack_from(f"<{count}H", data, at + 10)
        check = 0x55AA ^ (kind | count << 8) ^ first ^ last
        for s in samples:
            check ^= s
        if count == 0 or check != told:
            at = data.find(HEADER, at + 1)
            continue
        begin, sweep = (first >> 1) / 64, ((last >> 1) / 64 - (first >> 1) / 64) % 360
        step = sweep / (count - 1) if count > 1 else 0.0
        found.append(Packet(bool(kind & 1),
                            tuple(math.radians((begin + k * step) % 360) for k in range(count)),
                            tuple(s / 4000 for s in samples)))
        at = data.find(HEADER, end)
    return found


def verdict(found: list[Packet], seconds: float) -> tuple[bool, str]:
    """Whether it delivers, and a sentence with the figures."""
    turns = sum(p.first for p in found) / seconds
    points = [(a, r) for p in found if not p.first for a, r in zip(p.angles, p.ranges, strict=True)]
    seen = [(a, r) for a, r in points if r > 0]
    if not points:
        return False, "nothing readable came: wrong port, data wire, or it does not turn"
    ahead = sorted(r for a, r in seen if min(a, 2 * math.pi - a) < AHEAD)
    front = f"{ahead[len(ahead) // 2]:.2f} m" if ahead else "nothing"
    text = (f"{turns:.1f} turns and {len(points) / seconds:.0f} points per second, "
            f"{100 * len(seen) / len(points):.0f} % saw something; straight ahead {front}")
    return turns >= 3 and len(seen) > 0.2 * len(points), text


def listen(port: str, seconds: float = SECONDS) -> bytes:
    """Start it, read for a while, stop it. Raises serial.SerialException."""
    with serial.Serial(port, BAUD, timeout=0.1) as line:
        line.dtr = True  # the adapter switches the motor by this line
        line.write(STOP + START)
        data, until = bytearray(), time.monotonic() + seconds
        while time.monotonic() < until:
            data += line.read(4096)
        line.write(STOP)
        return bytes(data)


def main() -> int:
    """Ask it and print one line."""
    adapters = [p.device for p in list_ports.comports() if (p.vid, p.pid) == (0x10C4, 0xEA60)]
    port = (sys.argv[1:] + adapters + [""])[0]
    if port in ("", "-h", "--help"):
        sys.stdout.write(__doc__ or "")
        if not port:
            sys.stderr.write("no CP2102 adapter (10c4:ea60) found; name the port\n")
        return 0 if port else 2
    try:
        good, text = verdict(packets(listen(port)), SECONDS)
    except (OSError, serial.SerialException) as error:
        sys.stderr.write(f"{port}: {error}; expected the lidar's adapter, try ls /dev/ttyUSB*\n")
        return 2
    sys.stdout.write(f"{port}: {text}\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
