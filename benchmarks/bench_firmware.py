"""Sizes: STATE on the wire, and the firmware's budgets."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from math import nan

from bare_nano import BareNano
from figures import Figure

from dart_hal.devices.links.image import FIRMWARE_DIR
from dart_hal.wire.messages import STATE

LINE = re.compile(r"^(\S.*?) {2,}(\d+) (\S+) +(<=|>=) (\d+)", re.MULTILINE)


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; ``scale`` shortens the stretch whose frames are measured."""
    sizes = state_sizes(max(0.2, 2.0 * scale))
    return [Figure("STATE on the wire", max(sizes), "B", 44, 44,
                   f"{len(sizes)} frames of the firmware, shortest {min(sizes)} B"),
            *budgets()]


def state_sizes(seconds: float) -> list[int]:
    """Bytes of each STATE, delimiter included, as they left the UART."""
    with BareNano() as bare:
        bare.run(1.0)
        end, sizes = bare.bytes, []
        for frame, _ in bare.run(seconds):
            if frame.message is STATE:
                sizes.append(frame.end - end)
            end = frame.end
    return sizes


def budgets() -> list[Figure]:
    """What ``make -C firmware size`` measures; nothing where there is no AVR compiler."""
    if shutil.which("avr-size") is None:
        return []
    done = subprocess.run(["make", "-s", "--no-print-directory", "-C", str(FIRMWARE_DIR), "size",
                           f"PYTHON={sys.executable}"], capture_output=True, text=True, check=False)
    rows = parse(done.stdout)
    if rows:
        return rows
    why = (done.stderr.strip().splitlines() or ["no output"])[-1]
    return [Figure("firmware: budgets", nan, "", high=0, note=f"make -C firmware size: {why}")]


def parse(text: str) -> list[Figure]:
    """Figures of the lines ``name  value unit  <= limit``, or ``>=`` for a floor."""
    rows = []
    for name, value, unit, sign, limit in LINE.findall(text):
        low, high = (float(limit), None) if sign == ">=" else (None, float(limit))
        rows.append(Figure(f"firmware: {name}", float(value), unit, low, high))
    return rows
