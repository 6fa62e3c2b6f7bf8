"""Screws: long enough for what they clamp, one for each hole of the CAD, all in the bill."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest

from tests.common import ROOT

sys.path.insert(0, str(ROOT / "hardware"))

import bom_table
import guide
import screws

BUILT_CAD = json.loads((ROOT / "hardware" / "cad" / "built.json").read_text(encoding="utf-8"))
PARTS = BUILT_CAD["parts"]
WIDE = {("base_plate", "nano_imu_mount"): 1, ("camera_bracket", "upper_plate"): 2}
"""Holes that are not one per screw: a spare one, and one screw through two jaws."""


def find_uncovered(rows: list[screws.Screw]) -> list[str]:
    """Screw holes of the CAD without a screw, or with too many."""
    have: dict[tuple[str, str], int] = {}
    for s in rows:
        for hole in set(s.holes):
            have[hole] = have.get(hole, 0) + s.pieces
    per_car = {r.id: r.quantity for r in bom_table.load()}
    found = []
    for part, table in PARTS.items():
        uses = [h["use"] for h in table["holes"] if h["screw"]]
        for use in sorted(set(uses)):
            holes = uses.count(use) * per_car[part]
            expected = WIDE.get((part, use), holes)
            if have.pop((part, use), 0) != expected:
                found.append(f"{part}: {use}")
    return found + [f"{part}: {use}, no such hole" for part, use in have]


def test_no_screw_is_too_short_or_too_long():
    assert screws.wrong(screws.load(), PARTS) == []


def test_a_short_screw_is_detected():
    rows = [replace(s, length=6) if s.name == "M3 x 10" else s for s in screws.load()]
    short = [s for s in screws.load() if s.name == "M3 x 10"]
    assert len([x for x in screws.wrong(rows, PARTS) if "M3 x 6" in x]) == len(short)


def test_every_hole_has_its_screw():
    assert find_uncovered(screws.load()) == []


def test_a_forgotten_screw_is_detected():
    rows = [s for s in screws.load() if s.step != "S11"]
    assert set(find_uncovered(rows)) == {"base_plate: lidar", "lidar_mount: lidar"}


def test_the_diameter_is_that_of_the_hole():
    for s in screws.load():
        for part, use in s.holes:
            assert {h["screw"] for h in PARTS[part]["holes"] if h["use"] == use} == {s.size}


def test_the_bill_buys_them():
    row = next(r for r in bom_table.load() if r.id == "screws")
    assert row.part == screws.summary(screws.load())


def test_the_step_of_a_screw_names_screws():
    steps = {s.id: s for s in guide.steps()}
    assert [s.step for s in screws.load() if "screws" not in steps[s.step].parts] == []


def test_parts_of_the_cad_are_those_of_the_bill():
    assert set(PARTS) == {r.id for r in bom_table.load() if r.ours}


@pytest.mark.parametrize("kind", ["placements", "items"])
def test_what_the_assembly_shows_is_in_the_bill_and_in_its_step(kind):
    rows = {r.id: r for r in bom_table.load()}
    for thing in BUILT_CAD[kind]:
        name = thing.get("bom") or thing["part"]
        assert name in rows
        assert name == "kit" or thing["step"] in rows[name].used_in, (name, thing["step"])


def test_a_thicker_cup_of_the_lidar_moves_head_and_nut():
    """The grip comes from the parameter file: what was measured counts, and is refused by name."""
    p = screws.parameters.read()
    p.lidar.ear = 4.6
    assert screws.wrong(screws.load(p=p), PARTS) == []
    p.lidar.ear = 5.5
    assert screws.wrong(screws.load(p=p), PARTS) == [
        "S11 M3 x 25: 1.5 mm beyond a grip of 23.5, expected 2.4 to 6.4"]
