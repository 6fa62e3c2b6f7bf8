"""Which screw goes where: screws.csv, with the grip taken from the holes of the CAD."""

from __future__ import annotations

import csv
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE / "cad"))
import parameters  # noqa: E402 - found through the line above
from parameters import Parameters  # noqa: E402

NUT = {"M2": 1.6, "M2.5": 2.0, "M3": 2.4}
"""Height of a hexagon nut, mm (ISO 4032)."""
SIDES = {"up": "from below", "down": "from above", "front": "from the rear",
         "rear": "from the front"}
"""Where the head is, for each way in which a screw is driven."""
STUD = 6.0
"""Length of the thread of a standoff, mm [assumed]."""


@dataclass(frozen=True, slots=True)
class Screw:
    """``holes``: (part, use) as in the hole tables of the CAD, head first; ``other`` [mm] of
    bought parts that it also clamps, below the head or before the nut (``other_at``: head, tail,
    or empty: between the parts); ``length`` 0 = a nut on the thread of a standoff.

    ``drive``: way in which it is driven (up, down, front, rear). ``through``: bought part in which
    its shank or thread sits. ``beside``: bodies that are there when it is driven in the hand;
    empty = in the car, with everything of the steps before.
    """

    size: str
    length: float
    pieces: int
    step: str
    holes: tuple[tuple[str, str], ...]
    other: float
    other_at: str
    drive: str
    head: str
    material: str
    end: str
    through: str
    beside: tuple[str, ...]
    note: str

    @property
    def name(self) -> str:
        return f"{self.size} x {self.length:g}" if self.length else f"nut {self.size}"


def thickness(cell: str, p: Parameters | None) -> float:
    """A number of mm, or a dimension of the parameter file by its name."""
    try:
        return float(cell)
    except ValueError:
        group, key = cell.split(".")
        return float(getattr(getattr(p or parameters.read(), group), key))


def load(path: Path = HERE / "screws.csv", p: Parameters | None = None) -> list[Screw]:
    """Every row, in the order of the build. ``p``: another parameter file than the committed."""
    with path.open(encoding="utf-8", newline="") as file:
        return [Screw(c["screw"], float(c["length_mm"]), int(c["pieces"]), c["step"],
                      tuple(tuple(h.split(":", 1)) for h in c["holes"].split(";")),  # type: ignore[misc]
                      thickness(c["other_mm"], p), c["other_at"], c["drive"], c["head"],
                      c["material"], c["end"], c["through"],
                      tuple(filter(None, c["beside"].split(";"))), c["note"])
                for c in csv.DictReader(file)]


def grip(screw: Screw, parts: dict[str, dict[str, list[dict[str, float]]]]) -> float:
    """What the screw clamps [mm]. ``parts``: the table of built.json. Raises KeyError."""
    total = screw.other
    for part, use in screw.holes:
        lengths = {h["length"] for h in parts[part]["holes"] if h["use"] == use}
        if len(lengths) != 1:
            raise KeyError(f"{part} has {len(lengths)} kinds of hole for {use!r}")
        total += lengths.pop()
    return total


def wrong(screws: list[Screw], parts: dict[str, dict[str, list[dict[str, float]]]]) -> list[str]:
    """Screws that are too short or too long: grip + nut + at most 4 mm; into a thread 2 to 6 mm."""
    out = []
    for screw in screws:
        clamped = grip(screw, parts)
        length = screw.length or STUD
        low, high = (2.0, 6.0) if screw.end == "thread" else (
            NUT[screw.size], NUT[screw.size] + 4.0)
        if not low - 1e-6 <= length - clamped <= high + 1e-6:
            out.append(f"{screw.step} {screw.name}: {length - clamped:.1f} mm beyond a grip of "
                       f"{clamped:.1f}, expected {low} to {high}")
    return out


def made(screw: Screw) -> str:
    """Its material where that is not steel, with a space; its head where only that one fits."""
    return f"{screw.material} " if screw.material != "steel" else (
        "button head " if screw.head == "button" else "")


def summary(screws: list[Screw]) -> str:
    """What has to be bought: "Screws: M2 x 8 (4), ...; nuts: M2 (4), ...; washers"."""
    sizes: Counter[tuple[str, str, float]] = Counter()
    nuts: Counter[str] = Counter()
    for s in screws:
        if s.length:
            sizes[made(s), s.size, s.length] += s.pieces
        if s.end == "nut":
            nuts[("" if s.material == "steel" else s.material + " ") + s.size] += s.pieces
    return ("Screws: " + ", ".join(f"{m}{a} x {b:g} ({n})"
                                   for (m, a, b), n in sorted(sizes.items()))
            + "; nuts: " + ", ".join(f"{a} ({n})" for a, n in sorted(nuts.items()))
            + "; washers")


def table(screws: list[Screw]) -> str:
    """Markdown for the guide."""
    lines = ["| step | screw | pieces | driven | where |", "|---|---|---:|---|---|"]
    for s in screws:
        parts = ", ".join(dict.fromkeys(f"`{part}`" for part, _ in s.holes))
        end = " + nut" if s.end == "nut" and s.length else ""
        note = f": {s.note}" if s.note else ""
        lines.append(f"| {s.step} | {made(s)}{s.name}{end} | {s.pieces} | {SIDES[s.drive]} "
                     f"| {parts}{note} |")
    return "\n".join(lines).replace(" x ", "\u00a0x\u00a0")
