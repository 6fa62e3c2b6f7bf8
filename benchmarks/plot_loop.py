"""Draw where the loop of an emulated car spends its CPU time, by sampled stacks.

    python benchmarks/plot_loop.py docs/pictures/loop_flame.png

Above, the tick of the world in Python; below, as it runs. A box is a function, its width the time
in it and in what it calls; boxes narrower than 0.5 % are left out.
"""

from __future__ import annotations

import argparse
import os
import signal
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

import matplotlib.pyplot as plt
from bench_emulation import URL, drive

from dart_hal.car import Car
from dart_hal.vehicle.native.kernel import find_kernel
from dart_hal.vehicle.native.library import NATIVE_SWITCH

SECONDS = 40.0
SAMPLE_S = 0.001
MIN_SHARE = 0.005
# A name is written into boxes that are wide enough for it: share of the picture per character.
CHARACTER_SHARE = 0.0062
COLOURS = {"dart_hal": "#7fb3d5", "dart_lab": "#f0b27a"}
OTHER_COLOUR = "#d5d8dc"


@dataclass
class Box:
    """A function on the stack: samples in it, and the functions that it called."""

    count: int = 0
    calls: dict[tuple[str, str], Box] = field(default_factory=dict)


def sample_stacks(native: str) -> tuple[Box, float]:
    """Return the tree of sampled calls below ``drive``, and CPU time [ms] per second of the car."""
    root = Box()

    def take_sample(number: int, frame: FrameType | None) -> None:
        stack = []
        while frame is not None and frame.f_code is not drive.__code__:
            path = frame.f_code.co_filename
            stack.append((next((p for p in COLOURS if f"/{p}/" in path), ""),
                          frame.f_code.co_name))
            frame = frame.f_back
        box = root
        box.count += 1
        for key in reversed(stack):
            box = box.calls.setdefault(key, Box())
            box.count += 1

    find_kernel.cache_clear()
    with patch.dict(os.environ, {NATIVE_SWITCH: native}), Car.open(URL) as car:
        car.arm()
        drive(car, 1.0)
        signal.signal(signal.SIGPROF, take_sample)
        begun = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, SAMPLE_S, SAMPLE_S)
        drive(car, SECONDS)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        return root, 1e3 * (time.process_time() - begun) / SECONDS


def draw_box(axes: Any, box: Box, total: int, left: float, level: int) -> None:
    """Draw the calls of a box next to each other, each with its own calls above it."""
    for (package, name), called in sorted(box.calls.items(), key=lambda item: -item[1].count):
        share = called.count / total
        if share < MIN_SHARE:
            break
        axes.barh(level, share, left=left, height=0.95, align="edge", edgecolor="white",
                  linewidth=0.5, color=COLOURS.get(package, OTHER_COLOUR))
        if share > CHARACTER_SHARE * len(name):
            axes.text(left + 0.5 * share, level + 0.45, name, ha="center", va="center",
                      fontsize=6.5)
        draw_box(axes, called, total, left, level + 1)
        left += share


def main() -> None:
    """Sample both loops and save the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    picture = parser.parse_args().picture
    figure, rows = plt.subplots(2, 1, figsize=(11, 9), sharex=True, layout="constrained")
    for axes, native, title in zip(rows, "01", ("tick of the world in Python",
                                                "tick of the world compiled"), strict=True):
        root, cost = sample_stacks(native)
        draw_box(axes, root, root.count, 0.0, 0)
        axes.set_title(f"{title}: {cost:.0f} ms of CPU per second of the car", fontsize=10)
        axes.set_yticks([])
        axes.spines[["top", "left", "right"]].set_visible(False)
    rows[-1].set_xlim(0.0, 1.0)
    rows[-1].set_xlabel("share of the CPU time; blue: dart_hal, orange: dart_lab, grey: libraries")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
