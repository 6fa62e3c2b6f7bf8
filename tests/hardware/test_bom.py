"""The bill of materials: the paper's rows, nothing missing, nothing counted twice."""

from __future__ import annotations

import csv
import re
import sys
from decimal import Decimal
from pathlib import Path

import pytest

from tests.common import ROOT

sys.path.insert(0, str(ROOT / "hardware"))

import bom
import bom_page
import bom_table
import guide
from bom_page import page

PAPER = {"kit": 420, "lidar": 100, "encoder": 10, "imu": 40, "nano": 30, "lipo": 30, "servo": 20,
         "plates": 20}
"""EUR, the paper's table of components."""


def wrong_prices(rows: list[bom_table.Row]) -> dict[str, Decimal]:
    paper = {r.id: r.cost for r in rows if r.tier == "paper"}
    return {k: v for k, v in paper.items() if PAPER.get(k) != v}


@pytest.fixture
def change_row(tmp_path):
    """``spoilt(id, **cells)``: a copy of the bill with cells of one row changed."""
    def change(row: str, **cells: str) -> Path:
        with (ROOT / "hardware" / "bom.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        next(r for r in rows if r["id"] == row).update(cells)
        with (tmp_path / "bom.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
        return tmp_path / "bom.csv"

    return change


def test_the_papers_eight_rows_add_up_to_its_total():
    paper = [r for r in bom_table.load() if r.tier == "paper"]
    assert [r.id for r in paper] == list(PAPER)
    assert bom_table.total(paper) == Decimal("670.00")
    assert wrong_prices(paper) == {}


def test_a_changed_price_is_detected(change_row):
    rows = bom_table.load(change_row("imu", unit_price_eur="41.00"))
    assert wrong_prices(rows) == {"imu": Decimal("41.00")}


@pytest.mark.parametrize("cell", bom_table.FILLED)
def test_a_row_without_a_cell_names_it(change_row, cell):
    with pytest.raises(bom_table.BomError, match=rf"line \d+ \(.*\): no {cell}$"):
        bom_table.load(change_row("cells", **{cell: ""}))


@pytest.mark.parametrize(("cell", "value", "message"), [
    ("tier", "free", "expected one of paper, needed, optional, computer"),
    ("unit_price_eur", "six", "is 'six', expected EUR as 12.50"),
    ("unit_price_eur", "nan", "is 'nan', expected EUR"),
    ("unit_price_eur", "-6", "is '-6', expected EUR"),
    ("price_2026_eur", "7", "priced_on '', expected a price and the day"),
    ("priced_on", "2026-05-31", "price_2026_eur is '', expected EUR"),
    ("spares_20", "some", "spares_20 is 'some', expected a whole number"),
    ("route", "pi4", "route is 'pi4', expected one of kit, pi5, orin, desk"),
    ("quantity", "0", "quantity below 1"),
    ("unit_price_eur", "0", "paid by another row costs 0"),
    ("source", "paid:nobody", "price 6.00, source"),
    ("skill", "solder", "with 0 solder joints"),
    ("custom", "bent", "expected one of printed, cut, bought"),
    ("id", "kit", "kit stands in 2 rows"),
])
def test_a_bad_cell_names_what_was_expected(change_row, cell, value, message):
    with pytest.raises(bom_table.BomError, match=message):
        bom_table.load(change_row("cells", **{cell: value}))


def test_who_pays_must_be_a_row(change_row):
    with pytest.raises(bom_table.BomError, match="'nobody', which is no row"):
        bom_table.load(change_row("jetson", source="paid:nobody"))


def test_a_cell_too_many_is_detected(tmp_path):
    text = (ROOT / "hardware" / "bom.csv").read_text(encoding="utf-8")
    path = tmp_path / "bom.csv"
    path.write_text(text.replace(",glue,", ",glue,,", 1), encoding="utf-8")
    with pytest.raises(bom_table.BomError, match="expected one per column"):
        bom_table.load(path)


def test_the_minimal_build_has_no_solder_joint():
    rows = bom_table.load()
    assert sum(r.joints for r in rows if r.smallest or r.tier != "optional") == 0
    assert sum(r.joints for r in rows) > 0, "the control: options do"


def test_the_smallest_car_is_part_of_the_complete_one():
    assert all(r.full and r.tier != "optional" for r in bom_table.load() if r.smallest)


def test_what_is_bought_names_what_to_search_for():
    assert [r.id for r in bom_table.load() if r.price and not r.search_for] == []


def test_every_tool_of_a_row_is_in_the_list_of_tools():
    tools = {t.id for t in bom_table.load_tools()}
    assert {t for r in bom_table.load() for t in r.tools} <= tools


def test_a_row_and_a_tool_that_no_step_uses_are_named(change_row):
    rows = bom_table.load(change_row("heat_shrink", id="heat_gun", used_in="S05;S06"))
    assert bom.unused(rows, bom_table.load_tools(), guide.steps()) == [
        "heat_gun (bom.csv): no step of the build guide uses it",
        "heat_shrink: step S05, S14, W09, W16, W17 uses it, and bom.csv has no such row"]
    rows = bom_table.load(change_row("glue", used_in="S03;S04;S05;S06"))
    assert bom.unused(rows, bom_table.load_tools(), guide.steps()) == [
        "glue (bom.csv): used_in says S06, which does not name it"]
    steps = [s for s in guide.steps() if "brush" not in s.tools]
    assert "brush (tools.csv): no step of the build guide uses it" in bom.unused(
        bom_table.load(), bom_table.load_tools(), steps)


@pytest.mark.slow
def test_nothing_is_written_from_a_bill_with_such_a_row(monkeypatch, change_row, capsys):
    path = change_row("heat_shrink", id="heat_gun")
    pages = bom.generated()
    monkeypatch.setattr(bom, "load", lambda: bom_table.load(path))
    monkeypatch.setattr(Path, "write_text", lambda *_, **__: pytest.fail("something is written"))
    monkeypatch.setattr(sys, "argv", ["bom.py"])
    assert bom.main() == 2
    assert "heat_gun (bom.csv): no step" in (message := capsys.readouterr().err)
    assert message.endswith("nothing was written\n")
    assert {bom.PAGE, bom.DECK, bom.PRINT} == set(pages)


def test_every_route_is_complete_and_priced_once():
    rows = bom_table.load()
    for route in ("kit", "pi5", "orin"):
        car = bom_page.complete(rows, route)
        assert len([r for r in car if r.id in ("kit", "kit_bare")]) == 1
        assert len([r for r in car if r.id in ("jetson", "pi5", "orin")]) == 1
        assert sum(r.joints for r in car) == 0
        assert f"{bom_table.total(car)}" in page(rows, bom_table.load_tools())
    assert not {"buck_5v", "boost_12v"} & {r.id for r in bom_page.complete(rows, "kit")}


def test_a_price_of_today_is_shown_with_its_day(change_row):
    rows = bom_table.load(change_row("cells", price_2026_eur="7.25", priced_on="2026-05-31"))
    text = page(rows, bom_table.load_tools())
    assert "| 24.00 (6.00 each) | 29.00<br>2026-05-31 |" in text
    assert "| 1 of 30 rows |" in text


def test_the_class_set_is_twenty_cars_and_what_breaks():
    text = page(bom_table.load(), bom_table.load_tools())
    assert "| `ir_module` | 20 | 5 | 25 |  |" in text
    assert "| `cells` | 80 | 8 | 88 | 528.00 |" in text


def test_the_pages_are_generated():
    """The bill itself, and in the guide its tables."""
    old = [p.name for p, text in bom.generated().items() if p.read_text(encoding="utf-8") != text]
    assert old == [], "python hardware/bom.py"


def test_the_page_prices_cars_and_counts_parts():
    rows = bom_table.load()
    text = page(rows, bom_table.load_tools())
    for some in ([r for r in rows if r.smallest], bom_page.complete(rows, "kit"),
                 [r for r in rows if r.full]):
        assert f"{bom_table.total(some)}" in text
    assert "| smallest | 2 | 2 | 0 |" in text


def cars_of(text: str) -> list[tuple[str, str, str, str]]:
    """(EUR, cut, printed, joints) of each car in the guide's table."""
    return re.findall(r"\| ([\d.]+) \| (\d+), (\d+) \| (\d+) \|$", text, re.MULTILINE)


def test_the_guide_matches_the_page():
    guide = ROOT / "docs" / "build_guide" / "01_parts.md"
    cars_of_guide = cars_of(guide.read_text(encoding="utf-8"))
    text = page(bom_table.load(), bom_table.load_tools())
    sums = re.findall(r"^\| \**(?:smallest car|car of the paper|full car)[^|]* \| \**([\d.]+)",
                      text, re.MULTILINE)
    parts = re.findall(r"^\| (?:smallest|of the paper, complete|full) \| (\d+) \| (\d+) \| (\d+) ",
                       text, re.MULTILINE)
    assert cars_of_guide == [(s, *p) for s, p in zip(sums, parts, strict=True)]
    assert len(cars_of_guide) == 3
    assert cars_of("| a car | 574.00 | 2, 2 | 0 |")[0] not in cars_of_guide, "the control"


def test_gpl_stays_in_the_emulator():
    """simavr is GPL-3: only the bridge that links it carries that licence."""
    marked = {p.relative_to(ROOT).parts[:2] for folder in ("firmware", "host")
              for p in (ROOT / folder).rglob("*") if p.suffix in {".c", ".h", ".cpp", ".py"}
              and "build" not in p.parts
              and "GPL-3.0-or-later" in p.read_text(encoding="utf-8")[:80]}
    assert marked == {("firmware", "emulator")}
