"""The generated page of the bill of materials, from rows and tools alone."""

from __future__ import annotations

from decimal import Decimal

from bom_table import ROUTES, TIERS, Row, Tool, total

TITLES = {
    "paper": "The paper's table",
    "needed": "What that table leaves out",
    "optional": "Options",
    "computer": "Another computer",
}
COMPLETE = ("paper", "needed")
"""Tiers of the car of the paper, with what its table leaves out."""
CARS = 20
UPSTREAM_PARTS = (5, 6, 1)
"""Cut, printed, and named in the text but in no published file (the Hall holder): per car, counted
in upstream's build instructions (Lorenzo-Lyons/DART)."""


def page(rows: list[Row], tools: list[Tool]) -> str:
    """Markdown of the whole page."""
    parts = [HEAD, _prices(rows), _routes(rows), _counts(rows)]
    parts += [_tier(tier, [r for r in rows if r.tier == tier]) for tier in TIERS]
    return "\n".join([*parts, _class(rows), _tools(tools)])


def _prices(rows: list[Row]) -> str:
    tier = {t: total([r for r in rows if r.tier == t]) for t in TIERS}
    smallest = total([r for r in rows if r.smallest])
    lines = ["| | EUR |", "|---|---:|"]
    lines += [f"| {TITLES[t]} (`{t}`) | {tier[t]} |" for t in TIERS if t != "computer"]
    lines += [f"| **smallest car that runs** | **{smallest}** |",
              "| car of the paper, complete (`paper` + `needed`) "
              f"| {tier['paper'] + tier['needed']} |",
              f"| full car, every option, cut-off L4 | {total([r for r in rows if r.full])} |"]
    return "## What it costs\n\n" + "\n".join(lines) + "\n\n" + SMALLEST


def _routes(rows: list[Row]) -> str:
    """The complete car with each computer, and how much of it was priced again."""
    lines = ["| computer | complete car, EUR | without | instead | priced in 2026 |",
             "|---|---:|---|---|---:|"]
    for route in ("kit", "pi5", "orin"):
        car = complete(rows, route)
        others = [r for r in rows if r.price and r.tier in COMPLETE and not r.on(route)]
        instead = [r for r in car if r.price and r.route]
        names = ["", ""] if route == "kit" else [
            ", ".join(f"`{r.id}`" for r in some) for some in (others, instead)]
        paid = [r for r in car if r.price]
        asked = [r for r in paid if r.price_2026 is not None]
        lines.append(f"| {ROUTES[route]} | {total(car)} | {names[0]} | {names[1]} "
                     f"| {len(asked)} of {len(paid)} rows |")
    return "## Computers\n\n" + "\n".join(lines) + "\n\n" + COMPUTERS


def complete(rows: list[Row], route: str) -> list[Row]:
    """Rows of a complete car with one of the computers."""
    return [r for r in rows if r.tier in (*COMPLETE, "computer") and r.on(route)]


def _class(rows: list[Row]) -> str:
    """What to order for a class; parts that are made are counted, for their print time."""
    lines = [f"## Class set: {CARS} cars with spares\n", CLASS,
             "| id | in the cars | spares | order | EUR |", "|---|---:|---:|---:|---:|"]
    sum_of = Decimal(0)
    for r in complete(rows, "kit"):
        if r.price or r.spares:
            order = CARS * r.quantity + r.spares
            sum_of += order * r.price
            lines.append(f"| `{r.id}` | {CARS * r.quantity} | {r.spares or ''} | {order} "
                         f"| {order * r.price or ''} |")
    other = sum((CARS * r.quantity + r.spares) * r.price for r in complete(rows, "pi5"))
    lines.append(f"| **sum, {ROUTES['kit']}** | | | | **{sum_of}** |")
    lines.append(f"| sum, {ROUTES['pi5']} | | | | {other} |\n")
    return "\n".join(lines)


def _counts(rows: list[Row]) -> str:
    cars = {"smallest": [r for r in rows if r.smallest],
            "of the paper, complete": [r for r in rows if r.tier in COMPLETE],
            "full": [r for r in rows if r.full]}
    cut, printed, missing = UPSTREAM_PARTS
    lines = ["| car | cut parts | printed parts | solder joints |", "|---|---:|---:|---:|"]
    for name, some in cars.items():
        made = {kind: sum(r.quantity for r in some if r.ours and r.custom == kind)
                for kind in ("cut", "printed")}
        joints = sum(r.joints for r in some)
        lines.append(f"| {name} | {made['cut']} | {made['printed']} | {joints} |")
    lines.append(f"| upstream | {cut} | {printed} + {missing} | 0 by the paper |")
    return "## Custom parts and solder joints\n\n" + "\n".join(lines) + "\n\n" + UPSTREAM


def _tier(tier: str, rows: list[Row]) -> str:
    lines = [f"## {TITLES[tier]}\n",
             "| id | part | quantity | EUR | EUR 2026 | search for | step |",
             "|---|---|---:|---:|---:|---|---|"]
    for r in rows:
        kind = f" ({r.custom})" if r.ours else ""
        note = f"<br>{r.note}" if r.note else ""
        search = "<br>".join(x for x in (r.part_number and f"{r.part_number} [assumed]",
                                         r.search_for, r.alternatives and f"or: {r.alternatives}")
                             if x)
        quantity = str(r.quantity) if r.unit == "piece" else f"{r.quantity} {r.unit}"
        lines.append(f"| `{r.id}` | **{r.part}**{kind}: {r.purpose}{note} | {quantity} "
                     f"| {_price(r)} | {_today(r)} | {search} | {', '.join(r.used_in)} |")
    if tier == "computer":  # nobody buys all of them
        return "\n".join([*lines, ""])
    lines.append(f"| | **sum** | | **{total(rows)}** | | | |\n")
    return "\n".join(lines)


def _price(row: Row) -> str:
    if row.source.startswith("paid:"):
        return f"in `{row.source[5:]}`"
    each = f" ({row.price:.2f} each)" if row.quantity > 1 else ""
    return f"{row.cost:.2f}{each}"


def _today(row: Row) -> str:
    if row.price_2026 is None:
        return ""
    return f"{row.quantity * row.price_2026:.2f}<br>{row.priced_on}"


def _tools(tools: list[Tool]) -> str:
    lines = ["## Tools\n", "Not in the sums. A complete set costs about "
             f"{sum(t.price for t in tools if not t.optional)} EUR [assumed], the tools of options "
             f"{sum(t.price for t in tools if t.optional)} EUR more.\n",
             f"| id | tool | EUR | for {CARS} cars | note |", "|---|---|---:|---:|---|"]
    lines += [f"| `{t.id}` | {t.tool}{' (options)' if t.optional else ''} | {t.price or ''} "
              f"| {t.for_20} | {t.note} |" for t in tools]
    return "\n".join(lines) + "\n"


HEAD = """\
# Bill of materials

Parts, prices and tools of the car. `python hardware/bom.py` generates this page from
`hardware/bom.csv`; change the table there.

| what | meaning |
|---|---|
| prices of the tier `paper` | those of the paper (2024) |
| all other prices | **assumed**, rounded, without postage: correct them when you order |
| *in `kit`* and the like | another row pays for the part |
| *EUR 2026* | price of all units of a row and the day of the quote (`price_2026_eur` per unit, \
and `priced_on`, in the file); empty: no quote yet |
| *[assumed]* behind a part number | written from memory, not looked up: compare it with the offer |
| step | of the [build guide](../build_guide/01_parts.md) |
"""

COMPUTERS = """\
The kit's computer, the Jetson Nano, is near the end of its sale and stays at JetPack 4. The other
two routes buy the kit without computer, a computer, and a regulator for it. They solder nothing:
steps W12 and W13 of [the wiring](../build_guide/06_wiring.md#options). On the desk a laptop with
`usb_i2c` is enough. Prices of kit, computers and regulators are assumed.
"""

CLASS = """\
The complete car with the kit's computer, twenty times, and what breaks in a class [assumed: count
your losses and correct `spares_20`]. The last table has the tools for twenty cars.
"""

SMALLEST = """\
*Smallest car that runs*: kit, striped ring with its infrared sensor, IMU, Nano, base plate, cells.
It has the stock servo, a motor fed by the cells of the board, no lidar and no camera bracket. It
calibrates, drives and records; everything else can be added later. The row `plates` counts in full
although this car has only one of the three.
"""

UPSTREAM = """\
Upstream is the published design (Lorenzo-Lyons/DART, build instructions), counted per car. Its Hall
holder is named in the text but is in no published file: the `+ 1`. Its instructions solder nothing,
and neither does this car without options. The IMU named there (Adafruit 2472) comes with loose
pins, four joints [assumed: look at yours]; so the row `imu` is one with a plug.
"""
