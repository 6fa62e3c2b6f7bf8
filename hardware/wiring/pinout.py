"""Where the pins are: the Nano from above and from below, the multiplexer from above."""

from __future__ import annotations

import re
from pathlib import Path

from circuit import goals, names
from drawing import PAINT, WIDTH, Sheet
from harness import DIAGRAMS, HERE, parts, wires

NANO = (["D13", "3V3", "AREF", "A0", "A1", "A2", "A3", "A4", "A5", "A6", "A7", "5V", "RST",
         "GND", "VIN"],
        ["D12", "D11", "D10", "D9", "D8", "D7", "D6", "D5", "D4", "D3", "D2", "GND", "RST",
         "RX0", "TX1"])
"""Rows of the Nano seen from above, from the USB socket on: left, right."""
SHORT = {" kOhm": "k", " nF": "n", "bare wire to": "wire to"}
"""Words of the tables, and what has room beside a pin."""
HALF, LINE = 52, 9
"""Half the width of a body, and between two lines beside one pin [px]."""
STEP = 19
"""Between two pins [px]."""


Ends = dict[str, tuple[str, list[str]]]
"""Pin -> colour of its wire, what is at the other ends."""


def ends(folder: Path = HERE) -> Ends:
    """Of the Nano, over all diagrams."""
    known = parts(folder)["connectors"]
    found: Ends = {}
    for name in DIAGRAMS:
        for wire in wires(name, folder):
            for (here, pin), (there, other) in ((wire.start, wire.end), (wire.end, wire.start)):
                if here == "NANO":
                    option = "" if name == "minimal" else " *"
                    goal = f"{known[there]['short']} {re.sub(' by [^)]+', '', other)}{option}"
                    found.setdefault(pin, (wire.colour, []))[1].append(goal)
    return found


def body(sheet: Sheet, title: str, rows: tuple[list[str], list[str]],
         found: Ends, mark: str) -> None:
    """One board or chip with both rows; what a pin goes to stands outside, below its name."""
    sheet.y += 18
    sheet.text(WIDTH / 2, sheet.y, title, 12, "bold", "middle")
    top, middle = sheet.y + 22, WIDTH / 2
    sheet.rect(middle - HALF, top, 2 * HALF, STEP * len(rows[0]) + 8, "#dfe8f5")
    sheet.rect(middle - 20, top - 10, 40, 16, "#c7c9cc")
    sheet.text(middle, top + 2.5, mark, 9, anchor="middle")
    for side, column in ((-1, rows[0]), (1, rows[1])):
        for n, name in enumerate(column):
            y = top + 4 + STEP * (n + 0.5)
            x = middle + side * HALF
            anchor, outside = ("end", "start") if side > 0 else ("start", "end")
            colour, goal = found.get(name, ("", []))
            if goal:
                sheet.wire(*sorted((x, x + 14 * side)), y, colour)
            for line, words in enumerate(goal):
                low = y + 3.5 + LINE * (line - (len(goal) - 1) / 2)
                sheet.text(x + 18 * side, low, words, 9, anchor=outside)
            sheet.parts.append(f"<circle cx='{x:g}' cy='{y:g}' r='4.5' stroke='#333' "
                               f"fill='{PAINT[colour] if goal else '#fff'}'/>")
            sheet.text(x - 9 * side, y + 4, name.split("|")[0], 10.5,
                       "bold" if goal else "normal", anchor)
    sheet.y = top + STEP * len(rows[0]) + 14


def nano(folder: Path = HERE) -> str:
    """From both sides: the wires are plugged from below."""
    found = ends(folder)
    extra, supply = (found.pop(f"{pin} ICSP {n}", None) for pin, n in (("GND", 6), ("5V", 2)))
    rows = tuple([_ground(n, beside) for n in row]
                 for row, beside in zip(NANO, ("GND by VIN", "GND by D2"), strict=True))
    named = {_ground(k, k): v for k, v in found.items()}
    sheet = Sheet()
    body(sheet, "From above (components)", (rows[0], rows[1]), named, "USB")
    body(sheet, "From below (where the wires are plugged)", (rows[1], rows[0]), named, "USB")
    if extra:
        sheet.paragraph(f"The third GND is the corner pin 6 of the block of six at the end without "
                        f"USB, across from the corner marked 1: {', '.join(extra[1])}.")
    if supply:
        sheet.paragraph("Pin 2 of that block, next to the one marked 1 on its short side, is 5 V: "
                        f"{', '.join(supply[1])}.")
    sheet.paragraph("* only with that option.")
    return sheet.svg("Pins of the Nano")


def _ground(name: str, beside: str) -> str:
    """Both rows have a GND: told apart behind a bar that is not printed."""
    return f"GND|{beside}" if name == "GND" or name.startswith("GND by") else name


def mux(folder: Path = HERE) -> str:
    """From above, notch up: each pin with all that hangs on it."""
    known = {pin: f"{pin} {name}" for pin, name in names("MUX", folder).items()}
    colours = {pin.split(" ")[0]: wire.colour for wire in wires("cutoff_mux", folder)
               if (pin := wire.pin_at("MUX"))}
    found: Ends = {}
    for pin, goal in goals("MUX", folder).items():
        found[known[pin]] = colours.get(pin, "BK"), [_shorter(x) for x in goal]
    pins = list(known.values())
    sheet = Sheet()
    body(sheet, "74HCT157 from above", (pins[:8], pins[:7:-1]), found, "notch")
    sheet.paragraph("1k lies in the lead, 10k and 100n stand on the board beside the chip; 9 and "
                    "12 are outputs and stay open.")
    return sheet.svg("Pins of the multiplexer")


def _shorter(words: str) -> str:
    for long, short in SHORT.items():
        words = words.replace(long, short)
    return words


PINOUTS = {"nano_pins": nano, "mux_pins": mux}
