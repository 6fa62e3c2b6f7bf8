"""The board of the multiplexer from mux_board.yml: what it joins, and its drawing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from circuit import names
from drawing import PAINT, WIDTH, Sheet
from harness import HERE, WiringError, parts, read, wires

PITCH, LEFT = 28, 36
"""Between two holes, and from the edge to the first column [px]."""
TITLE = 34
"""Above the first row [px]."""


def layout(folder: Path = HERE) -> dict[str, Any]:
    """mux_board.yml as it stands."""
    return read(folder / "mux_board.yml")


def holes(data: dict[str, Any]) -> list[str]:
    """Every hole of the board: A1 to the last one."""
    row, columns = data["size"]
    return [f"{chr(r)}{c}" for r in range(ord("A"), ord(row) + 1) for c in range(1, columns + 1)]


def socket(data: dict[str, Any], pins: int) -> dict[str, str]:
    """Pin -> hole, in the order of a DIP: along one row, back along the other."""
    first, last = data["socket"]
    half = pins // 2
    at = {str(n + 1): f"{first[0]}{int(first[1:]) + n}" for n in range(half)}
    return at | {str(pins - n): f"{last[0]}{int(last[1:]) + n}" for n in range(half)}


def passed(a: str, b: str) -> list[str]:
    """Holes from ``a`` to ``b`` along a row or a column. Raises WiringError."""
    if a[0] != b[0] and a[1:] != b[1:]:
        raise WiringError(f"mux_board.yml: a wire from {a} to {b} lies in no row or column")
    rows = range(min(ord(a[0]), ord(b[0])), max(ord(a[0]), ord(b[0])) + 1)
    columns = range(min(int(a[1:]), int(b[1:])), max(int(a[1:]), int(b[1:])) + 1)
    return [f"{chr(r)}{c}" for r in rows for c in columns]


def nets(data: dict[str, Any]) -> dict[str, str]:
    """Hole -> the first hole of what it is joined to. Raises WiringError."""
    net = {hole: hole for hole in holes(data)}
    for a, b in data["wires"]:
        try:
            old = {net[hole] for hole in passed(a, b)}
        except KeyError as error:
            raise WiringError(f"mux_board.yml: a wire passes {error}, which is no hole") from None
        net = {hole: min(old) if joint in old else joint for hole, joint in net.items()}
    return net


def place(hole: str) -> tuple[float, float]:
    """x, y of a hole in the drawing [px]."""
    return LEFT + PITCH * (int(hole[1:]) - 1), TITLE + PITCH * (ord(hole[0]) - ord("A") + 1)


def line(sheet: Sheet, a: str, b: str, colour: str, thick: float) -> None:
    (x0, y0), (x1, y1) = place(a), place(b)
    sheet.parts.append(f"<line x1='{x0:g}' y1='{y0:g}' x2='{x1:g}' y2='{y1:g}' stroke='{colour}' "
                       f"stroke-width='{thick:g}' stroke-linecap='round'/>")


def dot(sheet: Sheet, hole: str, radius: float, fill: str) -> None:
    x, y = place(hole)
    sheet.parts.append(f"<circle cx='{x:g}' cy='{y:g}' r='{radius:g}' fill='{fill}' "
                       "stroke='#333'/>")


def drawing(folder: Path = HERE) -> str:
    """SVG of the board from above, the wires of its solder side seen through it."""
    data, sheet = layout(folder), Sheet()
    row, columns = data["size"]
    sheet.text(WIDTH / 2, 18, "The board of the multiplexer, from above", 12, "bold", "middle")
    sheet.rect(LEFT - 16, TITLE + 12, PITCH * (columns - 1) + 32,
               PITCH * (ord(row) - ord("A")) + 32, "#f3e6c4")
    for hole in holes(data):
        dot(sheet, hole, 3, "#fff")
    _names(sheet, row, columns)
    for a, b in data["wires"]:
        line(sheet, a, b, PAINT[""], 5)
    pins = names(data["device"], folder)
    at = socket(data, len(pins))
    (x0, y0), (x1, y1) = place(at["16"]), place(at["8"])
    sheet.rect(x0 - 11, y0 - 11, x1 - x0 + 22, y1 - y0 + 22, "none", "#1b1b1b")
    sheet.text(x0 + 1.5 * PITCH, y0 + 1.6 * PITCH, "74HCT157", 10, "bold", "middle")
    for pin, hole in at.items():
        dot(sheet, hole, 8, "#dfe8f5")
        x, y = place(hole)
        sheet.text(x, y + 3.5, pin, 9, anchor="middle")
    for part, ends in data["parts"].items():
        for a, b in ends:
            line(sheet, a, b, "#1b1b1b", 9)
            line(sheet, a, b, "#c98f4e" if part.startswith("res") else "#e8c81e", 7)
    sheet.y = place(f"{row}1")[1] + 20
    _leads(sheet, data, folder)
    sheet.paragraph("Grey: bare wire on the solder side. Brown: 10 kOhm, standing. Yellow: 100 nF. "
                    "The notch of the chip points to column 1.")
    return sheet.svg("The board of the multiplexer")


def _names(sheet: Sheet, row: str, columns: int) -> None:
    for n in range(1, columns + 1):
        sheet.text(place(f"A{n}")[0], TITLE + 8, str(n), 9, anchor="middle", fill="#666")
    for r in range(ord("A"), ord(row) + 1):
        sheet.text(LEFT - 24, place(f"{chr(r)}1")[1] + 3, chr(r), 9, anchor="middle", fill="#666")


def _leads(sheet: Sheet, data: dict[str, Any], folder: Path) -> None:
    """A coloured dot at each hole of a lead, and below the board what it is."""
    known = parts(folder)["connectors"]
    for hole, (pin, far) in data["leads"].items():
        wire, other = lead(data["device"], str(pin), far, folder)
        dot(sheet, hole, 7, PAINT[wire])
        by = " by its 1 kOhm" if any(end == [f"lead {pin}", pin] for part in
                                     known[data["device"]]["on_board"].values()
                                     for end in part["between"]) else ""
        sheet.paragraph(f"{hole}: {known[far]['short']} {other}{by}")


def lead(device: str, pin: str, far: str, folder: Path = HERE) -> tuple[str, str]:
    """Colour and far pin of the wire from ``far`` to ``pin``. Raises WiringError."""
    for wire in wires("cutoff_mux", folder):
        here, other = wire.pin_at(device), wire.pin_at(far)
        if here is not None and other is not None and here.split(" ")[0] == pin:
            return wire.colour, other
    raise WiringError(f"mux_board.yml: no wire of cutoff_mux.yml leads from {far} to pin {pin}")
