"""CPU time of the virtual world per tick of 1 ms, everything included.

    python benchmarks/bench_world.py
"""

from __future__ import annotations

import time

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.base import open_backend

URLS = ("sim://?nano=mock", "sim://?nano=mock&seed=3", "sim://?nano=mock&physics=kinematic",
        "sim://?nano=avr&seed=3")
SECONDS = 5.0
COUNT_US = 4.88


def driving(url: str) -> float:
    """us of CPU per tick while the car drives a circle at throttle 0.3."""
    backend = open_backend(url)
    bus, link = backend.bus, backend.link
    assert bus is not None
    for data in (b"\x00\x31", b"\xfe\x79", b"\x00\x21"):
        bus.writeto(0x40, data)

    def pulses(*widths: float) -> None:
        counts = (round(w / COUNT_US) for w in widths)
        body = b"".join(bytes((0, 0, n & 255, n >> 8)) for n in counts)
        bus.writeto(0x40, b"\x06" + body)

    def run(seconds: float) -> None:
        end = backend.clock.now() + seconds
        while backend.clock.now() < end:
            link.read(0.01)

    pulses(1500, 1500)
    run(2.5)
    pulses(1600, 1635)
    begin = time.process_time()
    run(SECONDS)
    spent = time.process_time() - begin
    backend.close()
    return spent / SECONDS * 1e3


def main() -> None:
    for url in URLS:
        try:
            best = min(driving(url) for _ in range(3))
        except EmulatorMissing as missing:
            print(f"{url:36} {missing.what}")
            continue
        print(f"{url:36} {best:6.1f} us per tick, {1000 / best:6.1f} times real time")


if __name__ == "__main__":
    main()
