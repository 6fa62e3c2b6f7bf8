"""Sizes: STATE on the wire, and the firmware's budgets."""

from __future__ import annotations

import re
import shutil
import subprocess

from bare_nano import BareNano
from figures import Figure

from dart_hal.links.image import FIRMWARE_DIR
from dart_hal.wire.messages import STATE


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
    """What ``make -C firmware size`` prints: lines of ``name value unit (budget <= n)``."""
    if shutil.which("avr-size") is None:
        return []
    done = subprocess.run(["make", "-s", "--no-print-directory", "-C", str(FIRMWARE_DIR), "size"],
                          capture_output=True, text=True, check=False)
    if "No rule to make target" in done.stderr:
        return []
    return [row for line in done.stdout.splitlines() if (row := _budget(line)) is not None]


LINE = re.compile(r"\s*(?P<name>[A-Za-z][\w ,.()/+-]*?)[:\s]\s*(?P<value>\d+) *(?P<unit>[A-Za-z]*)"
                  r"\W+.*?(?P<bound><=|>=)? *(?P<budget>\d+)")


def _budget(line: str) -> Figure | None:
    found = LINE.match(line)
    if found is None:
        return None
    budget = float(found["budget"])
    least = found["bound"] == ">=" or "free" in found["name"]
    return Figure(f"firmware: {found['name']}", float(found["value"]), found["unit"],
                  low=budget if least else None, high=None if least else budget)
