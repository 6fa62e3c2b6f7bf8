"""Drill sheets at full size, and the table of the printed parts."""

from __future__ import annotations

import importlib
import re
import sys

import pytest

from tests.common import HARDWARE, ROOT

sys.path[:0] = [str(HARDWARE)]
sys.path.append(str(HARDWARE / "cad"))
drill_sheets, layout, parameters = (importlib.import_module(n) for n in (
    "drill_sheets", "layout", "parameters"))
printed = importlib.import_module("printed")
SHEETS = {s.name: s for s in layout.sheets(parameters.read())}


def off_scale(svg: str) -> list[str]:
    """By what a sheet is not at full size with its ruler."""
    size = re.search(r'width="([\d.]+)mm" height="([\d.]+)mm" viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    found = [] if size and size.groups()[:2] == size.groups()[2:] else ["not 1 mm per unit"]
    if not re.search(r'd="M19.0,21.0h100.0M', svg):
        found.append("no ruler of 100 mm")
    return found


@pytest.mark.parametrize("name", sorted(SHEETS))
def test_a_sheet_is_the_drawing_at_full_size(name):
    text = (HARDWARE / "drill" / f"{name}.svg").read_text(encoding="utf-8")
    assert text == drill_sheets.svg(SHEETS[name]), "make hardware ARGS=--write"
    assert off_scale(text) == []
    circles = [tuple(map(float, c)) for c in
               re.findall(r'<circle cx="([-\d.]+)" cy="([-\d.]+)" r="([\d.]+)"', text)]
    assert circles == [pytest.approx((h.x, -h.y, h.diameter / 2)) for h in SHEETS[name].holes]


def test_a_scaled_sheet_is_detected():
    text = drill_sheets.svg(SHEETS["base_plate"])
    assert off_scale(text.replace('width="210mm"', 'width="200mm"')) == ["not 1 mm per unit"]
    assert off_scale(text.replace("h100.0M", "h98.0M")) == ["no ruler of 100 mm"]


def test_a_part_larger_than_the_paper_is_refused():
    sheet = SHEETS["base_plate"]
    wide = layout.Sheet("wide", 3.0, tuple((2 * x, y, b) for x, y, b in sheet.outline), ())
    with pytest.raises(ValueError, match="wide: 344 x 140 mm do not fit on A4"):
        drill_sheets.svg(wide)


def test_every_printed_part_has_grams_hours_and_a_way_to_lie():
    rows = printed.rows()
    assert {r[0] for r in rows} == set(printed.LIES)
    assert all(g > 0 and minutes >= printed.START for _, _, _, g, minutes, _ in rows)
    page = (ROOT / "docs" / "build_guide" / "02_print_and_cut.md").read_text(encoding="utf-8")
    assert printed.table() in page, "python hardware/bom.py"


def test_every_part_has_a_step_file():
    parts = {f.stem for f in (HARDWARE / "stl").glob("*.stl")}
    assert {f.stem for f in (HARDWARE / "step").glob("*.step")} == parts
    for f in (HARDWARE / "step").glob("*.step"):
        text = f.read_text(encoding="utf-8")
        assert "MANIFOLD_SOLID_BREP" in text, f.name
        assert ".MILLI.,.METRE." in text, f.name
