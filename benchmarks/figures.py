"""A row of the table, and how time is taken: CPU time, best of a few rounds.

CPU time, because other work on the machine is not ours; the best round,
because a disturbance can only slow it down.
"""

from __future__ import annotations

import hashlib
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from math import isfinite
from pathlib import Path

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge
from dart_hal.devices.links.image import find_image


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured figure.

    ``low``, ``high``: what it must reach, None = no bound on that side; both
    None: a figure to compare with. ``note``: shown next to it.
    """

    name: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    note: str = ""

    @property
    def ok(self) -> bool | None:
        """Whether the target is met; None without a target."""
        if self.low is None and self.high is None:
            return None
        return (self.low is None or self.value >= self.low) and (
            self.high is None or self.value <= self.high)

    @property
    def target(self) -> str:
        """The target as text, for example ">= 8"."""
        if self.low is not None and self.low == self.high:
            return f"{self.low:g}"
        if self.low is not None and self.high is not None:
            return f"{self.low:g} to {self.high:g}"
        if self.low is not None:
            return f">= {quantity(self.low)}"
        return f"<= {quantity(self.high)}" if self.high is not None else "-"

    @property
    def measured(self) -> str:
        """Value and unit as text."""
        return f"{quantity(self.value)} {self.unit}".rstrip()


def quantity(value: float) -> str:
    """Three digits that count; whole numbers from 100 on."""
    if isfinite(value) and (value == round(value) or abs(value) >= 100):
        return f"{value:,.0f}"
    return f"{value:.3g}"


def best_cpu(work: Callable[[], object], rounds: int) -> float:
    """Least CPU time [s] of ``rounds`` runs of ``work``."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def machine() -> dict[str, str]:
    """What was measured on, and with which versions."""
    facts = {"machine": _processor(), "system": f"{platform.system()} {platform.release()}",
             "python": platform.python_version(), "numpy": version("numpy"),
             "dart-hal": version("dart-hal")}
    try:
        facts["simavr"] = bridge.load().emu_simavr().decode()
        facts["firmware"] = hashlib.sha256(find_image().read_bytes()).hexdigest()[:12]
    except EmulatorMissing as why:
        facts["simavr"] = f"none: {why.what}"
    return facts


def _processor() -> str:
    """Model of a core; Linux has it in /proc/cpuinfo."""
    listing = Path("/proc/cpuinfo")
    if sys.platform == "linux" and listing.is_file():
        for line in listing.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return f"one core of {line.partition(':')[2].strip()}"
    return f"one core of {platform.processor() or platform.machine()}"
