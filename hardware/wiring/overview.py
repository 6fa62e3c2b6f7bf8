"""One picture of the whole harness: each device once, each cable as a line with its connectors.

The connectors are those of ``metadata.ends`` in minimal.yml, the wires those of the diagrams.
"""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

from drawing import PAINT, Sheet
from harness import HERE, WiringError, chains, load, parts

WIDE, HIGH = 980, 560
BOX = 128
"""Width of a device [px]."""
PLACES: dict[str, tuple[int, int, int]] = {
    "ir_module": (10, 40, 70), "imu": (10, 140, 70), "servo": (10, 290, 70),
    "motor": (10, 440, 70), "nano": (294, 40, 170), "expansion_board": (294, 290, 70),
    "esc": (294, 440, 70), "jetson": (568, 40, 170), "cells": (568, 290, 70),
    "lipo_fuse": (568, 440, 70), "lidar_adapter": (842, 40, 70), "lipo": (842, 440, 70)}
"""Id of a device in bom.csv -> left, top and height of its box [px]."""
TITLES = {"nano": "Arduino Nano", "jetson": "Computer", "ir_module": "Infrared module",
          "imu": "IMU BNO055", "servo": "Servo", "motor": "Motor", "esc": "Speed controller",
          "expansion_board": "Expansion board", "cells": "Four 18650", "lipo_fuse": "Fuse 20 A",
          "lidar_adapter": "Lidar adapter", "lipo": "LiPo 2S"}
EXPLAINED = ("Below a line: the connector at each end of the cable. Female goes over pins, male "
             "has them. [a] assumed, look at yours before you buy an adapter. Options such as "
             "second ring and cut-off are not drawn.")


def find_ends(data: dict[str, Any], cable: str) -> tuple[str, str]:
    """Return the connectors of a cable. Raises WiringError if minimal.yml does not state them."""
    found = data["metadata"].get("ends", {}).get(cable)
    if found is None or len(found) != 2:
        raise WiringError(f"minimal.yml, metadata.ends: {cable} has {found!r}, expected the "
                          f"connectors at both ends")
    return found[0], found[1]


def draw_box(sheet: Sheet, part: str) -> None:
    """Draw a device at its place."""
    x, y, height = PLACES[part]
    sheet.rect(x, y, BOX, height, "#eef2f6")
    sheet.text(x + BOX / 2, y + height / 2 + 4, TITLES[part], 13, "bold", "middle")


def draw_cable(sheet: Sheet, way: list[tuple[float, float]], colours: list[str], title: str,
               ends: tuple[str, str]) -> None:
    """Draw the wires of a cable side by side, its name above, its connectors below."""
    # The wires of a cable lie next to each other: across its way, or across both parts of it.
    sideways = len(way) > 2 or way[0][0] == way[1][0]
    down = way[0][1] == way[1][1] or len(way) > 2
    for number, colour in enumerate(colours):
        shift = 3.2 * (number - (len(colours) - 1) / 2.0)
        line = " ".join(f"{x + shift * sideways:g},{y + shift * down:g}" for x, y in way)
        for paint, width in (("#333", 3.2), (PAINT[colour], 2.2)):
            sheet.parts.append(f"<polyline points='{line}' fill='none' stroke='{paint}' "
                               f"stroke-width='{width:g}'/>")
    (x0, y0), (x1, y1) = way[0], way[-1]
    if x0 == x1:
        lines = [title, f"above: {ends[0]}", f"below: {ends[1]}"]
        for number, words in enumerate(lines):
            sheet.text(x0 + 16, (y0 + y1) / 2 - 8 + 14 * number, words, 11,
                       "bold" if number == 0 else "normal")
        return
    middle = (x0 + x1) / 2
    top = y0 - 9 - 1.6 * len(colours)
    for number, words in enumerate(reversed(textwrap.wrap(title, 21))):
        sheet.text(middle, top - 13 * number, words, 11, "bold", "middle")
    low = y0 + 15 + 1.6 * len(colours)
    for x, words, anchor in ((x0 + 4, ends[0], "start"), (x1 - 4, ends[1], "end")):
        for number, line in enumerate(textwrap.wrap(words, 11)):
            sheet.text(x, low + 13 * number, line, 10.5, anchor=anchor)


def connect(first: str, second: str) -> list[tuple[float, float]]:
    """Return the way of a cable: straight across, or straight down, between two boxes."""
    x0, y0, high0 = PLACES[first]
    x1, y1, high1 = PLACES[second]
    if x0 == x1:
        upper, lower = sorted(((y0, high0), (y1, high1)))
        return [(x0 + BOX / 2, upper[0] + upper[1]), (x0 + BOX / 2, lower[0])]
    y = max(y0, y1) + min(high0, high1) / 2
    return [(x0 + BOX, y), (x1, y)] if x0 < x1 else [(x0, y), (x1 + BOX, y)]


def drawing(folder: Path = HERE) -> str:
    """SVG of the harness of the car without options."""
    data, known = load("minimal", folder), parts(folder)["connectors"]
    sheet = Sheet()
    sheet.text(WIDE / 2, 22, "Harness of the car without options", 14, "bold", "middle")
    for left, cable, right, rows in chains("minimal", folder):
        first, second = known[left]["pn"], known[right]["pn"]
        ends = find_ends(data, cable)
        kind = data["cables"][cable]
        title = str(kind["type"]) if len(rows) == 1 else f"{kind['type']}, {len(rows)} wires"
        colours = [colour for _, _, colour, _ in rows]
        if cable == "W_BOARD":
            # From the computer down to the board, around the cells.
            x, y, high = PLACES["jetson"]
            board_x, board_y, _ = PLACES["expansion_board"]
            way: list[tuple[float, float]] = [
                (x + 30, y + high - 12), (x + 30, 250), (board_x + 100, 250),
                (board_x + 100, board_y + 12)]
            draw_cable(sheet, way, colours, "", ("", ""))
            sheet.text(board_x + 116, 232, title, 11, "bold")
            of_board, of_computer = ends if first == "expansion_board" else ends[::-1]
            sheet.text(board_x + 116, 278, f"computer: {of_computer}, board: {of_board}", 10.5)
            continue
        way = connect(first, second)
        if way[0][0] > way[-1][0]:
            way, ends = way[::-1], ends[::-1]
        draw_cable(sheet, way, colours, title, ends)
    for part in PLACES:
        draw_box(sheet, part)
    sheet.y = HIGH - 30
    for number, line in enumerate(textwrap.wrap(EXPLAINED, 150)):
        sheet.text(10, sheet.y + 14 * number, line, 11, fill="#333")
    text = "\n".join(sheet.parts)
    return (f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDE} {HIGH}' width='{WIDE}' "
            f"height='{HIGH}' font-family='Helvetica, Arial, DejaVu Sans, sans-serif' role='img'>\n"
            f"<title>Harness of the car</title>\n<rect width='{WIDE}' height='{HIGH}' "
            f"fill='#fff'/>\n{text}\n</svg>\n")
