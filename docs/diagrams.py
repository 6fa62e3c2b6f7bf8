"""Draw the block diagrams of the handbook.

    python docs/diagrams.py            # writes docs/pictures/diagrams/*.svg
    python docs/diagrams.py safety     # one of them

Places and sizes are in units of a tenth of an inch, from the lower left corner.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from math import log10
from pathlib import Path
from typing import Any

import matplotlib
import tomlkit

matplotlib.use("svg")
from matplotlib import pyplot as plt
from matplotlib.patches import FancyBboxPatch, Rectangle

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "pictures" / "diagrams"
INK = "#22313f"
BLUE = "#dbe9f4"
GREEN = "#dff0e0"
RED = "#f6dcd9"
GREY = "#eceff1"
# Equal identifiers, and letters as outlines: a file depends neither on time nor on fonts.
plt.rcParams.update({"svg.hashsalt": "diagrams", "svg.fonttype": "path", "font.size": 9})


class Diagram:
    """A drawing of boxes, arrows and bars."""

    def __init__(self, width: float, height: float) -> None:
        self.figure, self.axes = plt.subplots(figsize=(width / 10.0, height / 10.0))
        self.figure.subplots_adjust(0.0, 0.0, 1.0, 1.0)
        self.axes.set(xlim=(0.0, width), ylim=(0.0, height))
        self.axes.axis("off")

    def add_box(self, x: float, y: float, width: float, height: float, title: str,
                lines: Sequence[str] = (), colour: str = BLUE) -> None:
        """Add a box with a title, and smaller lines below it."""
        self.axes.add_patch(FancyBboxPatch(
            (x, y), width, height, boxstyle="round,pad=0,rounding_size=0.8", fc=colour, ec=INK,
            lw=0.8))
        middle = x + width / 2.0
        top = y + height / 2.0 + 0.8 * len(lines)
        self.axes.text(middle, top, title, ha="center", va="center", color=INK, weight="bold")
        for number, line in enumerate(lines):
            self.axes.text(middle, top - 1.8 - 1.6 * number, line, ha="center", va="center",
                           color=INK, size=8)

    def add_arrow(self, start: tuple[float, float], end: tuple[float, float], label: str = "",
                  offset: tuple[float, float] = (0.0, 0.9), style: str = "-|>") -> None:
        """Add an arrow, with a label near its middle."""
        self.axes.annotate("", xy=end, xytext=start,
                           arrowprops={"arrowstyle": style, "color": INK, "lw": 1.1,
                                       "shrinkA": 0.0, "shrinkB": 0.0})
        self.add_text((start[0] + end[0]) / 2.0 + offset[0],
                      (start[1] + end[1]) / 2.0 + offset[1], label)

    def add_bar(self, x: float, y: float, width: float, label: str, colour: str = BLUE,
                height: float = 2.0) -> None:
        """Add a bar of a time line, its label in its middle."""
        self.axes.add_patch(Rectangle((x, y), width, height, fc=colour, ec=INK, lw=0.6))
        self.add_text(x + width / 2.0, y + height / 2.0, label)

    def add_text(self, x: float, y: float, text: str, align: str = "center") -> None:
        """Add a small text, centred on its height."""
        self.axes.text(x, y, text, ha=align, va="center", color=INK, size=8)

    def save(self, name: str) -> None:
        """Write the drawing as docs/pictures/diagrams/NAME.svg."""
        FOLDER.mkdir(exist_ok=True)
        self.figure.savefig(FOLDER / f"{name}.svg", facecolor="white", metadata={"Date": None})
        plt.close(self.figure)


def draw_safety() -> Diagram:
    """Draw where each layer of safety is, and after what time it makes the ESC neutral."""
    diagram = Diagram(72.0, 41.0)
    diagram.add_box(0.3, 23.0, 29.5, 17.7, "", colour="white")
    diagram.add_text(15.0, 39.5, "computer of the car")
    diagram.add_box(1.0, 32.0, 13.0, 6.0, "program", ["L0: context, signals"])
    diagram.add_box(16.0, 32.0, 13.0, 6.0, "guard process", ["L1: program silent"])
    diagram.add_box(1.0, 24.0, 28.0, 5.5, "dart-hal standby", ["L2: program and guard dead"])
    diagram.add_box(37.0, 32.0, 14.0, 6.0, "PCA9685", ["repeats its last pulse"], GREY)
    diagram.add_box(37.0, 23.0, 14.0, 6.5, "Nano",
                    ["cuts off if the", "heartbeat ends"], GREY)
    diagram.add_box(54.0, 27.0, 7.5, 7.0, "cut-off", ["L3 or L4"], GREEN)
    diagram.add_box(64.0, 27.0, 7.5, 7.0, "ESC", ["L5: no pulse"], RED)
    diagram.add_arrow((29.8, 35.0), (37.0, 35.0), "I2C")
    diagram.add_arrow((29.8, 26.8), (37.0, 26.8), "heartbeat")
    diagram.add_arrow((51.0, 35.0), (54.0, 32.0))
    diagram.add_arrow((51.0, 26.2), (54.0, 29.0))
    diagram.add_arrow((61.5, 30.5), (64.0, 30.5))
    diagram.add_text(1.0, 20.0, "time from the fault to neutral at the ESC", "left")
    # Rows: layer, shortest and longest time [ms]; the axis is logarithmic, from 10 ms to 3 s.
    rows = [("L0  program ends", 1, 20), ("L1  program dies or hangs", 50, 150),
            ("L2  guard dead as well", 150, 200), ("L3, L4  computer dead", 120, 140),
            ("L5  no pulse reaches the ESC", 100, 3000)]
    scale = 47.0 / 2.5
    for number, (label, first, last) in enumerate(rows):
        y = 15.5 - 3.0 * number
        start = 23.0 + scale * _decades(first)
        diagram.add_text(1.0, y + 1.0, label, "left")
        diagram.add_bar(start, y, 23.0 + scale * _decades(last) - start, "", GREEN)
    for time, label in ((10, "10 ms"), (100, "100 ms"), (1000, "1 s"), (3000, "3 s")):
        diagram.add_text(23.0 + scale * _decades(time), 1.4, label)
    return diagram


def _decades(time_ms: float) -> float:
    """Return the powers of ten from 10 ms to a time, not below 0."""
    return max(log10(time_ms / 10.0), 0.0)


def draw_slot() -> Diagram:
    """Draw what the firmware does in a slot of 10 ms."""
    diagram = Diagram(72.0, 17.0)
    scale = 5.6
    rows = [("encoder", [(0.0, 10.0, "interrupt at each edge", GREY)]),
            ("main loop", [(0.0, 0.8, "", RED), (9.6, 0.4, "", RED)]),
            ("IMU on I2C", [(0.8, 1.8, "look at gyro", BLUE),
                            (3.5, 6.0, "acceleration, then gyro", BLUE)])]
    for number, (label, bars) in enumerate(rows):
        y = 11.0 - 3.4 * number
        diagram.add_text(1.0, y + 1.2, label, "left")
        for start, length, text, colour in bars:
            diagram.add_bar(12.0 + scale * start, y, scale * length, text, colour, 2.4)
    diagram.add_text(17.2, 8.8, "latch, send STATE", "left")
    diagram.add_text(65.3, 8.8, "deadline", "right")
    for time in range(0, 11, 2):
        diagram.add_text(12.0 + scale * time, 2.4, f"{time} ms")
    diagram.add_text(12.0 + scale * 5.0, 15.6,
                     "Timer1 starts each slot, and counts the heartbeat down")
    return diagram


def draw_actuation() -> Diagram:
    """Draw the steps from a command to a pulse, and who decides what the pins may carry."""
    diagram = Diagram(78.0, 22.0)
    steps = [("command", "rad, -1 to 1"), ("expiry", "limits.py"),
             ("range, slew", "plan.py"), ("map", "steering_map.py"),
             ("counts", "quantiser.py"), ("one write", "pca9685.py")]
    for number, (title, place) in enumerate(steps):
        x = 1.0 + 13.0 * number
        diagram.add_box(x, 13.0, 11.0, 6.5, title, [place], GREY if number == 0 else BLUE)
        if number:
            diagram.add_arrow((x - 2.0, 16.2), (x, 16.2))
    diagram.add_box(27.0, 2.0, 24.0, 6.5, "supervisor",
                    ["states.py: its state decides", "what the pins may carry"], RED)
    diagram.add_arrow((39.0, 8.5), (32.5, 13.0))
    diagram.add_arrow((51.0, 5.2), (57.0, 5.2))
    diagram.add_box(57.0, 2.0, 20.0, 6.5, "heartbeat to the Nano", ["cut-off"], GREEN)
    diagram.add_box(1.0, 2.0, 20.0, 6.5, "events", ["arm, trip, stop, bus lost"], GREY)
    diagram.add_arrow((21.0, 5.2), (27.0, 5.2))
    return diagram


def draw_world() -> Diagram:
    """Draw the loop of the simulated car: program, board, physics, firmware."""
    diagram = Diagram(74.0, 27.0)
    diagram.add_box(0.5, 10.0, 15.0, 8.0, "your program", ["Car", "same code as on a car"], GREY)
    diagram.add_box(20.0, 18.0, 13.0, 7.0, "PCA9685", ["register model"])
    diagram.add_box(38.0, 18.0, 17.0, 7.0, "servo, ESC, motor",
                    ["backlash, delay, dead band"])
    diagram.add_box(59.0, 10.0, 14.0, 8.0, "bicycle model",
                    ["tyres, drag, effects", "1 ms a step"], GREEN)
    diagram.add_box(38.0, 2.0, 17.0, 7.0, "encoder, BNO055", ["edges, registers, noise"])
    diagram.add_box(18.0, 2.0, 15.0, 7.0, "Nano",
                    ["real firmware in simavr,", "or MockNano"], RED)
    diagram.add_arrow((10.0, 18.0), (20.0, 22.0), "I2C", (-2.0, 1.0))
    diagram.add_arrow((33.0, 21.5), (38.0, 21.5), "pulses")
    diagram.add_arrow((55.0, 21.5), (63.0, 18.0), "angle, force", (2.5, 1.2))
    diagram.add_arrow((63.0, 10.0), (55.0, 5.5), "motion", (3.0, -1.0))
    diagram.add_arrow((38.0, 5.5), (33.0, 5.5), "pins")
    diagram.add_arrow((18.0, 5.5), (10.0, 10.0), "frames", (-2.5, -1.0))
    diagram.add_text(37.0, 13.8, "virtual time: it passes while the program waits for a frame")
    return diagram


def draw_emulator() -> Diagram:
    """Draw what surrounds the processor in the emulated Nano."""
    diagram = Diagram(74.0, 29.0)
    diagram.add_box(27.0, 9.0, 20.0, 12.0, "ATmega328P",
                    ["simavr executes the image", "Timer1, EEPROM, watchdog,",
                     "brown-out, pins"], RED)
    parts = [(1.0, 21.0, "UART line", ["bit times, lost bytes"]),
             (1.0, 11.5, "encoder rings", ["edges at their cycle"]),
             (1.0, 2.0, "supply", ["brown-out, power off"]),
             (54.0, 21.0, "TWI bus", ["SCL periods, stretch,", "held lines"]),
             (54.0, 11.5, "BNO055", ["registers, boot, filters"]),
             (54.0, 2.0, "D5, D6, D9", ["cut-off, own pulse"])]
    for x, y, title, lines in parts:
        diagram.add_box(x, y, 19.0, 6.5, title, lines)
        left = x < 27.0
        start = (x + 19.0, y + 3.2) if left else (x, y + 3.2)
        end = (27.0 if left else 47.0, 15.0 + (y - 11.5) * 0.45)
        diagram.add_arrow(start, end, style="<|-|>")
    diagram.add_text(37.0, 27.2, "host: serial port, avr:// or a pty")
    diagram.add_text(37.0, 2.0, "world: wheel speed, acceleration, faults")
    diagram.add_arrow((33.0, 26.2), (20.0, 25.0), style="<|-|>")
    diagram.add_arrow((37.0, 3.0), (37.0, 9.0))
    return diagram


def draw_run() -> Diagram:
    """Draw what a recording contains, and what reads it."""
    diagram = Diagram(74.0, 30.0)
    sources = ["bytes of the Nano", "I2C transfers", "commands, applied pulses",
               "poses, scans, images", "what the program logs", "files of the car, HELLO"]
    readers = ["replay://: the same States", "dart-hal view, compare", "identify, diagnose, study",
               "export: table, ROS, LeRobot", "Foxglove, PlotJuggler"]
    diagram.add_box(30.0, 9.0, 14.0, 12.0, "run.mcap",
                    ["stamped, chunked,", "with its definitions"], GREEN)
    for number, text in enumerate(sources):
        y = 25.0 - 4.7 * number
        diagram.add_box(0.5, y, 21.5, 3.6, text, colour=GREY)
        diagram.add_arrow((22.0, y + 1.8), (30.0, 15.0 + (y - 13.0) * 0.35))
    for number, text in enumerate(readers):
        y = 24.0 - 5.2 * number
        diagram.add_box(52.0, y, 21.5, 3.8, text)
        diagram.add_arrow((44.0, 15.0 + (y - 13.0) * 0.35), (52.0, y + 1.9))
    return diagram


def draw_layers() -> Diagram:
    """Draw the layers of both packages, as pyproject.toml states them."""
    settings: dict[str, Any] = tomlkit.parse(
        (ROOT / "pyproject.toml").read_text(encoding="utf-8")).unwrap()
    contracts = {one["containers"][0]: one["layers"]
                 for one in settings["tool"]["importlinter"]["contracts"]
                 if one["type"] == "layers"}
    diagram = Diagram(78.0, 33.0)
    for x, package, title, colour in ((1.0, "dart_lab", "dart_lab: workstation", GREEN),
                                      (43.0, "dart_hal", "dart_hal: car", BLUE)):
        layers = contracts[package]
        diagram.add_text(x + 17.0, 31.4, title)
        for number, layer in enumerate(layers):
            parts = layer.split(" | ")
            width = 34.0 / len(parts)
            y = 30.0 - 3.3 * (number + 1)
            for place, part in enumerate(parts):
                diagram.add_box(x + width * place, y, width - 0.6, 2.7, part, colour=colour)
    diagram.add_arrow((34.8, 15.0), (43.0, 15.0), "imports")
    diagram.add_arrow((38.0, 28.0), (38.0, 20.0), "down", (2.5, 0.0))
    return diagram


DIAGRAMS: dict[str, Callable[[], Diagram]] = {
    "safety": draw_safety, "slot": draw_slot, "actuation": draw_actuation, "world": draw_world,
    "emulator": draw_emulator, "run": draw_run, "layers": draw_layers}


def main() -> None:
    """Draw the named diagrams, or all."""
    for name in sys.argv[1:] or DIAGRAMS:
        DIAGRAMS[name]().save(name)


if __name__ == "__main__":
    main()
