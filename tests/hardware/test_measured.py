"""The builder's log: what was measured gets into the drawings, what cannot be built does not."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from tests.common import ROOT

sys.path[:0] = [str(ROOT / "hardware")]

import measured  # noqa: E402 - found through the line above

parameters = measured.parameters
ASSUMED = ("gear", "lidar", "car", "steering", "battery", "mass")
"""Groups of bought things: all that is assumed of them has to be in the log."""
CHOSEN = {"lidar.slot", "lidar.pillar", "gear.hub_play", "battery.bar_above",
          "steering.crank_x", "steering.crank_y", "steering.kingpin_y"}
"""This project's own choices, and points of the drawing that nothing is built on."""


@pytest.fixture
def file(tmp_path):
    return Path(shutil.copy(parameters.FILE, tmp_path))


def test_values_are_entered_as_measured_and_nothing_else_changes(file):
    before = file.read_text(encoding="utf-8").splitlines()
    measured.enter(measured.parse("gear.hub = 8.35  # calliper\nlidar.ear=\n"
                                  "base_holes.adapter_x = 69.2, 86.1\n", "log"), file)
    after = file.read_text(encoding="utf-8").splitlines()
    changed = [b for a, b in zip(before, after, strict=True) if a != b]
    assert len(changed) == 2
    entry = parameters.read(file).raw["gear"]["hub"]
    assert (entry["value"], entry["source"]) == (8.35, "measured")
    assert entry["comment"] == parameters.read().raw["gear"]["hub"]["comment"]
    assert parameters.read(file).base_holes.adapter_x == (69.2, 86.1)


@pytest.mark.parametrize(("text", "message"), [
    ("gear.hub = 8,35", "gear.hub = \\[8.0, 35.0\\]: expected one number"),
    ("gear.hub = 12", "gear.hub"),
    ("rings.tip = 15.5", "rings.tip = 15.5 mm: outside its bounds 8 to 15 mm"),
    ("gear.hup = 8.3", "no such dimension: gear.hup; expected one of sheet.thickness"),
    ("gear.hub = wide", "log, line 1: gear.hub = 'wide' is no number"),
    ("gear.hub 8.3", "log, line 1: 'gear.hub 8.3'; expected for example gear.hub = 8.35"),
    ("gear.hub = 8.3\ngear.hub = 8.4", "line 2: gear.hub for the second time"),
])
def test_what_cannot_be_entered_is_named_and_the_file_stays(file, text, message):
    before = file.read_bytes()
    with pytest.raises(ValueError, match=message):
        measured.enter(measured.parse(text, "log"), file)
    assert file.read_bytes() == before


def test_the_page_lists_what_was_not_measured():
    raw = parameters.read().raw
    text = measured.PAGE.read_text(encoding="utf-8")
    assert measured.page(text) == text, "python hardware/measured.py --page"
    assumed = {f"{g}.{k}" for g in ASSUMED for k, e in raw[g].items()
               if e["source"] in ("assumed", "photo")}
    assert assumed - CHOSEN <= set(measured.MEASURE)
    assert assumed >= CHOSEN - {"gear.hub_play"}, "the control: they would be found"
