"""The multiplexer as a schematic, drawn from what stands on its board and what leads there."""

from __future__ import annotations

from pathlib import Path

from circuit import components, devices, joined, leads, names
from drawing import WIDTH, Sheet
from harness import HERE

CHIP = (176, 256)
"""Left and right edge of the body [px]."""
TALL, ROW, TOP = 58, 22, 52
"""Rows with a pull-down and without, and above the first [px]."""
BUS, AFTER = 292, 18
"""x of the ground that the right side shares; room for the capacitor below the supply [px]."""
INK = "#1b1b1b"


def stroke(sheet: Sheet, path: str, thick: float = 1.5) -> None:
    sheet.parts.append(f"<path d='{path}' fill='none' stroke='{INK}' stroke-width='{thick:g}'/>")


def ground(sheet: Sheet, x: float, y: float) -> None:
    """Symbol below (x, y)."""
    stroke(sheet, f"M{x - 8:g} {y:g} h16 M{x - 5:g} {y + 3.5:g} h10 M{x - 2:g} {y + 7:g} h4")


def resistor(sheet: Sheet, x: float, y: float, value: str, *, upright: bool = False) -> None:
    """A box of 24 x 9 from (x, y) on, to the right or down."""
    wide, high = (9, 24) if upright else (24, 9)
    left, top = (x - 4.5, y) if upright else (x, y - 4.5)
    sheet.rect(left, top, wide, high, "#fff", INK, 0)
    if upright:
        sheet.text(x + 7, y + 15.5, value, 9)
    else:
        sheet.text(x + 12, y + 14, value, 9, anchor="middle")


def dot(sheet: Sheet, x: float, y: float) -> None:
    sheet.parts.append(f"<circle cx='{x:g}' cy='{y:g}' r='2.4' fill='{INK}'/>")


class Chip:
    """What hangs on each pin of a multiplexer, and on which side it is drawn."""

    def __init__(self, device: str, folder: Path) -> None:
        self.names = names(device, folder)
        self.low = next(pin for pin, name in self.names.items() if name == "GND")
        some = components(device, folder)
        self.series = {c.ends[1]: _short(c.value) for c in some if c.ends[0].startswith("lead ")}
        self.down = {c.ends[0]: _short(c.value) for c in some
                     if "Ohm" in c.value and c.ends[1] == self.low}
        self.across = {c.ends[0]: _short(c.value) for c in some if "F" in c.value}
        self.tied = [pin for others in joined(device, folder).values() for pin in others]
        self.far: dict[str, list[str]] = {}
        for there, other, pin in leads(device, folder):
            self.far.setdefault(pin, []).append(f"{there} {other}".replace(" ICSP 6", ""))
        self.left = [pin for pin in self.names if pin in self.down]
        self.right = [pin for pin in self.names if pin in self.across] + [
            pin for pin in self.names if self.names[pin].endswith("Y")]
        self.tied_first = min(self.tied, key=int)
        self.right += [*sorted(self.tied, key=int), self.low]


def _short(value: str) -> str:
    return value.replace(" kOhm", "k").replace(" nF", "n")


def drawing(folder: Path = HERE, device: str = "MUX") -> str:
    """SVG, one page on a phone."""
    chip, sheet = Chip(device, folder), Sheet()
    title = devices(folder)[device]["type"]
    sheet.text(WIDTH / 2, 18, f"{title}: schematic", 13, "bold", "middle")
    high = max(TALL * len(chip.left), _height(len(chip.right)) - TOP)
    sheet.rect(CHIP[0], TOP - 14, CHIP[1] - CHIP[0], high + 6, "#eef2f8", INK, 2)
    sheet.text(sum(CHIP) / 2, TOP - 19, title.split()[-1], 11, "bold", "middle")
    for n, pin in enumerate(chip.left):
        _input(sheet, chip, pin, TOP + 10 + TALL * n)
    for n, pin in enumerate(chip.right):
        _right(sheet, chip, pin, _height(n))
    ground(sheet, BUS, _height(len(chip.right) - 1) + 20)
    sheet.y = TOP + high + 14
    sheet.paragraph("1k lies in the lead, the rest stands on the board. A pin with a cross stays "
                    "open. S low: the ESC gets the Nano's own pulse, and D8 nothing; high: the "
                    "ESC gets channel 1, and D8 channel 15.")
    return sheet.svg(f"{title}, schematic")


def _height(n: int) -> float:
    """y of pin ``n`` of the right side."""
    return TOP + ROW * n + (AFTER if n else 0)


def _pin(sheet: Sheet, chip: Chip, pin: str, y: float, side: int) -> None:
    """Name inside the body, number above the wire."""
    edge = CHIP[0] if side < 0 else CHIP[1]
    anchor = "start" if side < 0 else "end"
    sheet.text(edge - 5 * side, y + 4, chip.names[pin], 10.5, "bold", anchor)
    sheet.text(edge + 4 * side, y - 3, pin, 8.5, anchor="end" if side < 0 else "start", fill="#666")


def _input(sheet: Sheet, chip: Chip, pin: str, y: float) -> None:
    """Far end, series resistor, node with its pull-down, pin."""
    node = 146
    sheet.text(6, y - 6, chip.far[pin][0], 9.5, "bold")
    stroke(sheet, f"M6 {y:g} H86 M110 {y:g} H{CHIP[0]}")
    resistor(sheet, 86, y, chip.series[pin])
    dot(sheet, node, y)
    stroke(sheet, f"M{node} {y:g} v6 M{node} {y + 30:g} v4")
    resistor(sheet, node, y + 6, chip.down[pin], upright=True)
    ground(sheet, node, y + 34)
    _pin(sheet, chip, pin, y, -1)


def _right(sheet: Sheet, chip: Chip, pin: str, y: float) -> None:
    _pin(sheet, chip, pin, y, 1)
    edge, far = CHIP[1], chip.far.get(pin, [])
    if pin in chip.across:
        stroke(sheet, f"M{edge} {y:g} H{WIDTH - 6} M{BUS} {y:g} v6")
        stroke(sheet, f"M{BUS - 8} {y + 6:g} h16 M{BUS - 8} {y + 10:g} h16 M{BUS} {y + 10:g} v6", 2)
        dot(sheet, BUS, y)
        sheet.text(BUS + 12, y + 13, chip.across[pin], 9)
        ground(sheet, BUS, y + 16)
        sheet.text(WIDTH - 6, y - 5, far[0], 9.5, "bold", "end")
    elif pin in chip.tied or pin == chip.low:
        first = _height(chip.right.index(chip.tied_first))
        stroke(sheet, f"M{edge} {y:g} H{BUS}" + ("" if y == first else f" v-{ROW}"))
        dot(sheet, BUS, y)
        if pin == chip.low:
            stroke(sheet, f"M{BUS} {y:g} v20")
            for n, goal in enumerate(far):
                sheet.text(BUS + 6, y + 4 + 11 * n, goal, 9.5, "bold")
    elif far:
        stroke(sheet, f"M{edge} {y:g} H{WIDTH - 6}")
        if pin in chip.series:
            resistor(sheet, 270, y, chip.series[pin])
        sheet.text(WIDTH - 6, y - 5, far[0], 9.5, "bold", "end")
    else:
        stroke(sheet, f"M{edge} {y:g} h14 m-4 -4 l8 8 m0 -8 l-8 8")
