"""Cable routing: long enough, through openings of the plate, clear of the lidar; at true scale."""

from __future__ import annotations

import copy as copies
import json
import re
import sys
from math import dist

import pytest

from tests.common import ROOT, WIRING

sys.path[:0] = [str(WIRING), str(ROOT / "hardware"), str(ROOT / "hardware" / "cad")]

pytest.importorskip("yaml")
import harness  # noqa: E402 - found through the line above
import parameters  # noqa: E402
import plan  # noqa: E402
import routing  # noqa: E402

P = parameters.read()
BUILT_BY_NAME = {i["name"]: i
                 for i in json.loads((ROOT / "hardware" / "cad" / "built.json").read_text(
    encoding="utf-8"))["items"]}


def test_every_cable_has_a_route_that_can_be_laid():
    assert routing.faults() == []


@pytest.mark.parametrize(("file", "old", "new", "message"), [
    ("cutoff_mux.yml", "half of the board, length: 0.22", "half of the board, length: 0.075",
     "W_IN needs 155 mm, the cable has 75"),
    ("minimal.yml", "plugs at both ends, length: 0.5, wirecount: 4, colors: [RD, WH, GN, BK]}\n"
     "  W_LIDAR", "plugs at both ends, length: 0.3, wirecount: 4, colors: [RD, WH, GN, BK]}\n"
     "  W_LIDAR", "W_USB needs 330 mm, the cable has 300"),
    ("minimal.yml", "jumper wires, length: 0.3", "jumper wires, length: 0.2",
     "W_IR needs 265 mm, the cable has 200"),
    ("routing.yml", "[58, -56, 20], [50, -39.5, 6], [50, -39.5, -6]",
     "[58, -56, 20], [60, -39.5, 6], [60, -39.5, -6]",
     "W_OUT passes the plate at x 60, y -39.5, where it has no opening"),
    ("routing.yml", "[58, -56, 20], [62, -56, 68]", "[110, 20, 20], [62, -56, 68]",
     "W_NANO enters the lidar's rotor"),
    ("routing.yml", "[58, -56, 20], [62, -56, 68]", "[58, -85, 20], [62, -56, 68]",
     "W_NANO hangs 10 mm over the edge of the plate"),
    ("routing.yml", "servo_lead: 1.4", "servo_lead: 3.5",
     "the opening 'hole for cables' of 79 mm2"),
    ("routing.yml", "    W_SPARE:", "    # W_SPARE:", "W_SPARE of cutoff_mux.yml has no route"),
])
@pytest.mark.slow_except("routing.yml-servo*", "minimal*")
def test_a_route_that_cannot_be_laid_is_named(copy, file, old, new, message):
    folder = copy(file, old, new)
    assert any(fault.startswith(message)
               for fault in routing.faults(folder)), routing.faults(folder)
    with pytest.raises(harness.WiringError, match=re.escape(message)):
        plan.drawing("minimal", folder)


def test_an_opening_that_moves_takes_its_cable_along_or_is_reported():
    """The picture is drawn from the parameter file: a hole that is gone from there is gone here."""
    moved = copies.deepcopy(P)
    moved.base_holes.cable_x = (60.0, 48.0)
    imu = next(r for r in routing.routes(p=moved) if r.cable == "W_IMU")
    assert imu.passages[0][0][0] == 60.0
    assert any(fault.startswith("W_OUT passes the plate at x 50, y -39.5")
               for fault in routing.faults(p=moved))
    assert plan.drawing("minimal") != plan.drawing("minimal", p=_shift_imu())


def _shift_imu():
    p = copies.deepcopy(P)
    p.base_holes.imu_x = 38.0
    return p


@pytest.mark.parametrize(("old", "new", "message"), [
    ('W_NANO: ["@nano right",', 'W_NANO: ["@nano", ',
     "W_NANO: no place '@nano'; there are @infrared"),
    ("W_NANO: [", "W_NANOS: [", "has no cable W_NANOS; it has W_NANO"),
])
def test_an_unknown_name_is_refused_with_the_known_ones(copy, old, new, message):
    with pytest.raises(harness.WiringError, match=message):
        routing.faults(copy("routing.yml", old, new))


DRAWN = {"W_USB": "usb_nano", "W_LIDAR": "usb_lidar", "W_BOARD": "cable_6pin", "W_IR": "jumpers",
         "W_IMU": "jumpers", "W_SERVO": "lead_servo", "W_ESC": "lead_esc",
         "W_PACK": "battery_leads", "W_LIPO": "battery_leads"}
"""Lead -> its solid in the assembly."""


def ends(item: str) -> set[tuple[float, ...]]:
    """Ends of the bundles of a committed solid."""
    return {tuple(round(v, 3) for v in end) for s in BUILT_BY_NAME[item]["shapes"]
            if s["kind"] == "cylinder" for end in (s["start"], s["end"])}


def strays(found: list[routing.Route]) -> list[str]:
    """Leads whose plan is not the solid that collides, or the picture that is shown."""
    return [r.cable for r in found if r.cable in DRAWN
            and not {tuple(round(v, 3) for v in p) for p in r.points[1:-1]} <= ends(DRAWN[r.cable])]


def test_the_plan_shows_the_leads_that_are_solids_in_the_car():
    minimal = [r for r in routing.routes() if r.diagram == "minimal"]
    assert {r.cable for r in minimal} == set(DRAWN)
    assert strays(minimal) == []
    assert strays(routing.routes(p=_shift_imu())) == ["W_IMU"], "the control"


def test_the_picture_is_at_true_scale():
    svg = plan.drawing("minimal")
    wide, high, w_mm, h_mm = re.search(
        r"viewBox='0 0 ([\d.]+) ([\d.]+)' width='([\d.]+)mm' height='([\d.]+)mm'", svg).groups()
    assert (wide, high) == (w_mm, h_mm), "one unit is one millimetre"
    corners = [tuple(map(float, point.split(","))) for point in
               re.search(r"<polygon points='([^']+)'", svg)[1].split()]
    assert max(x for x, _ in corners) - min(x for x, _ in corners) == pytest.approx(
        2 * P.base.half_width, abs=0.1)
    assert max(y for _, y in corners) - min(y for _, y in corners) == pytest.approx(
        P.base.length, abs=0.1)


def test_a_route_is_as_long_as_its_stretches():
    imu = next(r for r in routing.routes() if r.cable == "W_IMU")
    assert imu.length == pytest.approx(sum(map(dist, imu.points, imu.points[1:])))
    assert imu.length + 20 <= 150, "the IMU's leads are short"
