"""Where the pins are: the Nano from above and from below, the multiplexer from above."""

from __future__ import annotations

from pathlib import Path

from drawing import PAINT, WIDTH, Sheet
from harness import DIAGRAMS, HERE, parts, wires

NANO = (["D13", "3V3", "AREF", "A0", "A1", "A2", "A3", "A4", "A5", "A6", "A7", "5V", "RST",
         "GND", "VIN"],
        ["D12", "D11", "D10", "D9", "D8", "D7", "D6", "D5", "D4", "D3", "D2", "GND", "RST",
         "RX0", "TX1"])
"""Rows of the Nano seen from above, from the USB socket on: left, right."""
MUX = (["S", "1I0", "1I1", "1Y", "2I0", "2I1", "2Y", "GND"],
       ["VCC", "/E", "4I0", "4I1", "4Y", "3I0", "3I1", "3Y"])
"""Pins 1 to 8 and 16 to 9 of the 74HCT157, from its notch on."""
STEP, HALF = 19, 52
"""Between two pins, and half the width of the body [px]."""


def ends(device: str, folder: Path = HERE) -> dict[str, tuple[str, str]]:
    """Pin -> (colour, what is at the other end), over all diagrams."""
    known = parts(folder)["connectors"]
    found = {}
    for name in DIAGRAMS:
        for wire in wires(name, folder):
            for (here, pin), (there, other) in ((wire.start, wire.end), (wire.end, wire.start)):
                if here == device:
                    option = "" if name == "minimal" or device != "NANO" else " *"
                    short = known[there]["short"]
                    found[pin] = wire.colour, f"{short} {other.split(' by')[0]}{option}"
    return found


def body(sheet: Sheet, title: str, rows: tuple[list[str], list[str]],
         found: dict[str, tuple[str, str]], mark: str) -> None:
    """One board or chip with both rows; what a pin goes to stands outside, below its name."""
    sheet.y += 18
    sheet.text(WIDTH / 2, sheet.y, title, 12, "bold", "middle")
    top, middle = sheet.y + 22, WIDTH / 2
    sheet.rect(middle - HALF, top, 2 * HALF, STEP * len(rows[0]) + 8, "#dfe8f5")
    sheet.rect(middle - 20, top - 10, 40, 16, "#c7c9cc")
    sheet.text(middle, top + 2.5, mark, 9, anchor="middle")
    for side, names in ((-1, rows[0]), (1, rows[1])):
        for n, name in enumerate(names):
            y = top + 4 + STEP * (n + 0.5)
            x = middle + side * HALF
            anchor, outside = ("end", "start") if side > 0 else ("start", "end")
            colour, goal = found.get(name, ("", ""))
            if goal:
                sheet.wire(*sorted((x, x + 14 * side)), y, colour)
                sheet.text(x + 18 * side, y + 3.5, goal, 9, anchor=outside)
            sheet.parts.append(f"<circle cx='{x:g}' cy='{y:g}' r='4.5' stroke='#333' "
                               f"fill='{PAINT[colour] if goal else '#fff'}'/>")
            sheet.text(x - 9 * side, y + 4, name.split("|")[0], 10.5,
                       "bold" if goal else "normal", anchor)
    sheet.y = top + STEP * len(rows[0]) + 14


def nano(folder: Path = HERE) -> str:
    """From both sides: the wires are plugged from below."""
    found = ends("NANO", folder)
    extra = found.pop("GND ICSP 6", None)
    rows = tuple([_ground(n, beside) for n in row]
                 for row, beside in zip(NANO, ("GND by VIN", "GND by D2"), strict=True))
    named = {_ground(k, k): v for k, v in found.items()}
    sheet = Sheet()
    body(sheet, "From above (components)", (rows[0], rows[1]), named, "USB")
    body(sheet, "From below (where the wires are plugged)", (rows[1], rows[0]), named, "USB")
    if extra:
        sheet.paragraph(f"The third GND is the corner pin 6 of the block of six at the end without "
                        f"USB, across from the corner marked 1: {extra[1]}.")
    sheet.paragraph("* only with that option.")
    return sheet.svg("Pins of the Nano")


def _ground(name: str, beside: str) -> str:
    """Both rows have a GND: told apart behind a bar that is not printed."""
    return f"GND|{beside}" if name == "GND" or name.startswith("GND by") else name


def mux(folder: Path = HERE) -> str:
    """From above, notch up."""
    numbers = [list(range(1, 9)), list(range(16, 8, -1))]
    found = {f"{p.split(' ')[0]} {p.split('(')[1][:-1]}": v for p, v in ends("MUX", folder).items()}
    joined = {str(x) for x in parts(folder)["metadata"]["joined"]["MUX"][8]}
    rows = tuple([f"{n} {name}" for n, name in zip(ns, row, strict=True)]
                 for ns, row in zip(numbers, MUX, strict=True))
    for pin in (*rows[0], *rows[1]):
        if pin.split()[0] in joined:
            found[pin] = "BK", "to pin 8"
    sheet = Sheet()
    body(sheet, "74HCT157 from above", (rows[0], rows[1]), found, "notch")
    return sheet.svg("Pins of the multiplexer")


PINOUTS = {"nano_pins": nano, "mux_pins": mux}
