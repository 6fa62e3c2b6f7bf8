"""A simulated car for real processes, which logs what reaches the ESC by CLOCK_MONOTONIC.

    python server.py URL FOLDER     prints one line of JSON, then serves until killed

``FOLDER/pulses``: a line "stamp width_us" for every pulse of the ESC, stamped
when the world has made it, so never too early. ``FOLDER/stalls``: a line
"stamp seconds" whenever this process did not get the processor for 10 ms; a
measurement that such a stall touches is no measurement of the car.
"""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import threading
import time
from pathlib import Path

from dart_hal.devices.links.base import open_backend
from dart_hal.devices.links.pty import Pty
from dart_lab.sim.serve import BusServer, PacedWorld
from dart_lab.sim.truth import world_of
from fault_table import switches, switches_nano  # noqa: F401 - the layers that may be gone
from fault_table.drive import ESC, weld_if_removed
from fault_table.layers import inherit

STALL = 0.010


class Log:
    """Lines of a file, each whole at once."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def line(self, *words: float) -> None:
        os.write(self._file, (" ".join(f"{word:.6f}" for word in words) + "\n").encode())


def watch_for_stalls(log: Log) -> None:
    """A thread that requires the processor every 2 ms."""
    before = time.monotonic()
    while True:
        time.sleep(0.002)
        now = time.monotonic()
        if now - before > STALL:
            log.line(now, now - before)
        before = now


def main(url: str, folder: Path) -> None:
    backend = open_backend(url)
    assert backend.car is not None
    assert backend.car_toml is not None
    toml = folder / "cars" / backend.car / "car.toml"
    toml.parent.mkdir(parents=True)
    toml.write_text(re.sub("arm_neutral = .*", "arm_neutral = 0.2", backend.car_toml))
    weld_if_removed(world_of(backend))
    pulses = Log(folder / "pulses")
    world_of(backend).watchers.append(
        lambda channel, pulse: pulses.line(time.monotonic(), (pulse[1] - pulse[0]) * 1e6)
        if channel == ESC else None)
    paced = PacedWorld(backend)
    threading.Thread(target=watch_for_stalls, args=(Log(folder / "stalls"),), daemon=True).start()
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    with BusServer(backend, paced, folder / "i2c"), Pty(paced, always=True) as port:
        name = folder / "port"              # as udev names a port, by any name of the kernel
        name.symlink_to(port.path)
        print(json.dumps({"url": f"serial://{name}?i2c=unix:{folder / 'i2c'}",
                          "port": str(name), "car": backend.car}), flush=True)
        for order in sys.stdin:
            if order.strip() == "unplug":
                port.unplug()
                name.unlink()
            elif order.strip() == "plug":
                port.plug()
                name.symlink_to(port.path)


if __name__ == "__main__":
    with inherit():
        main(sys.argv[1], Path(sys.argv[2]))
