"""The rows of the bill of materials and the tools, read from their tables and checked."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from datetime import date
from decimal import Decimal, InvalidOperation
from pathlib import Path

HERE = Path(__file__).resolve().parent
TIERS = ("paper", "needed", "optional", "computer")
ROUTES = {"kit": "Jetson Nano of the kit", "pi5": "Raspberry Pi 5", "orin": "Jetson Orin Nano",
          "desk": "laptop, desk only"}
"""Computers of the car; a row that names some of them is bought for these alone."""
CUSTOM = ("printed", "cut", "bought")
SKILLS = ("none", "screws", "glue", "solder")
FILLED = ("tier", "id", "part", "quantity", "unit", "unit_price_eur", "purpose", "custom", "skill",
          "solder_joints", "smallest", "full", "spares_20", "used_in", "source")
"""Cells that no row may leave empty."""


class BomError(ValueError):
    """A row that cannot be used: which one, what was found, what was expected."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the bill; ``price`` in EUR per unit, ``joints`` solder joints in all.

    ``part_number``: of its maker, "" where none was looked up.
    ``price_2026`` in EUR per unit and the day on which somebody asked, None and "" until then.
    ``spares``: units that twenty cars want beside their own. ``route``: see ROUTES, () = every one.

    ``smallest``, ``full``: part of the smallest car that runs, of the full one. What
    stands in for another row (printed ring for brass, L3 for L4) is in neither.
    """

    tier: str
    id: str
    part: str
    quantity: int
    unit: str
    price: Decimal
    price_2026: Decimal | None
    priced_on: str
    purpose: str
    part_number: str
    search_for: str
    alternatives: str
    custom: str
    skill: str
    joints: int
    smallest: bool
    full: bool
    route: tuple[str, ...]
    spares: int
    tools: tuple[str, ...]
    used_in: tuple[str, ...]
    source: str
    note: str

    @property
    def cost(self) -> Decimal:
        """EUR of all units."""
        return self.quantity * self.price

    def on(self, route: str) -> bool:
        """Whether a car with this computer has the part."""
        return not self.route or route in self.route

    @property
    def ours(self) -> bool:
        """A part that is made from a drawing of this project."""
        return self.custom != "bought" and self.source.startswith("paid:")


@dataclass(frozen=True, slots=True)
class Tool:
    """``price`` in EUR, 0 = not counted (a service, a thing that every lab has). ``for_20``: how
    many a class with twenty cars wants."""

    id: str
    tool: str
    price: int
    optional: bool
    for_20: int
    note: str


def _split(cell: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in cell.split(";") if word.strip())


def _one_of(name: str, cell: str, allowed: tuple[str, ...], where: str) -> str:
    if cell not in allowed:
        raise BomError(f"{where}: {name} is {cell!r}, expected one of {', '.join(allowed)}")
    return cell


def _yes(name: str, cells: dict[str, str], where: str) -> bool:
    return _one_of(name, cells[name], ("yes", "no"), where) == "yes"


def _whole(cell: str, name: str, where: str) -> int:
    if not cell.strip().isascii() or not cell.strip().isdigit():
        raise BomError(f"{where}: {name} is {cell!r}, expected a whole number, 0 or more")
    return int(cell)


def _eur(cell: str, name: str, where: str) -> Decimal:
    try:
        price = Decimal(cell)
    except InvalidOperation:
        price = Decimal("nan")
    if not price.is_finite() or price < 0:
        raise BomError(f"{where}: {name} is {cell!r}, expected EUR as 12.50")
    return price


def _asked(cells: dict[str, str], where: str) -> tuple[Decimal | None, str]:
    """Price of today and its day: both or none."""
    price, day = cells["price_2026_eur"].strip(), cells["priced_on"].strip()
    if not price and not day:
        return None, ""
    try:
        date.fromisoformat(day)
    except ValueError:
        raise BomError(f"{where}: price_2026_eur {price!r} with priced_on {day!r}, expected a "
                       "price and the day on which it was asked, as 2026-05-31") from None
    return _eur(price, "price_2026_eur", where), day


def row_of(cells: dict[str, str], line: int) -> Row:
    """Check one line of the file. Raises BomError that names part, cell and what was expected."""
    where = f"bom.csv line {line} ({cells.get('part') or cells.get('id') or 'no name'})"
    if None in cells or None in cells.values():
        raise BomError(f"{where}: {len([v for v in cells.values() if v is not None])} cells, "
                       "expected one per column; quote a cell that holds a comma")
    for name in FILLED:
        if not cells.get(name, "").strip():
            raise BomError(f"{where}: no {name}")
    quantity, joints, spares = (_whole(cells[n], n, where) for n in (
        "quantity", "solder_joints", "spares_20"))
    price = _eur(cells["unit_price_eur"], "unit_price_eur", where)
    if quantity < 1:
        raise BomError(f"{where}: quantity below 1")
    paid = cells["source"].startswith("paid:")
    if paid != (price == 0):
        raise BomError(f"{where}: price {price}, source {cells['source']!r}; what is paid by "
                       "another row costs 0 here, and only that")
    return Row(_one_of("tier", cells["tier"], TIERS, where), cells["id"], cells["part"], quantity,
               cells["unit"], price, *_asked(cells, where), cells["purpose"],
               cells["part_number"], cells["search_for"], cells["alternatives"],
               _one_of("custom", cells["custom"], CUSTOM, where),
               _one_of("skill", cells["skill"], SKILLS, where), joints,
               _yes("smallest", cells, where), _yes("full", cells, where),
               tuple(_one_of("route", word, tuple(ROUTES), where)
                     for word in _split(cells["route"])), spares,
               _split(cells["tools"]), _split(cells["used_in"]), cells["source"], cells["note"])


def load(path: Path = HERE / "bom.csv") -> list[Row]:
    """Every row of the bill, in the order of the file. Raises BomError."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row_of(cells, n) for n, cells in enumerate(csv.DictReader(file), start=2)]
    ids = [r.id for r in rows]
    for row in rows:
        if ids.count(row.id) > 1:
            raise BomError(f"{row.id} stands in {ids.count(row.id)} rows, expected one")
        if row.source.startswith("paid:") and row.source[5:] not in ids:
            raise BomError(f"{row.id} is paid by {row.source[5:]!r}, which is no row")
        if (row.skill == "solder") != (row.joints > 0):
            raise BomError(f"{row.id}: skill {row.skill} with {row.joints} solder joints")
    return rows


def load_tools(path: Path = HERE / "tools.csv") -> list[Tool]:
    """Every tool that guide and bill name."""
    with path.open(encoding="utf-8", newline="") as file:
        return [Tool(c["id"], c["tool"], int(c["price_eur"]), c["optional"] == "yes",
                     int(c["for_20"]), c["note"])
                for c in csv.DictReader(file)]


def total(rows: list[Row]) -> Decimal:
    """EUR of some rows, to the cent."""
    return sum((r.cost for r in rows), Decimal(0)).quantize(Decimal("0.01"))
