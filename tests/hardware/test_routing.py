"""Cable routing: long enough, through openings of the plate, clear of the lidar; at true scale."""

from __future__ import annotations

import copy as copies
import re
import sys
from math import dist
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WIRING = ROOT / "hardware" / "wiring"
sys.path[:0] = [str(WIRING), str(ROOT / "hardware"), str(ROOT / "hardware" / "cad")]

pytest.importorskip("yaml")
import harness  # noqa: E402 - found through the line above
import parameters  # noqa: E402
import plan  # noqa: E402
import routing  # noqa: E402

P = parameters.read()


def test_every_cable_has_a_route_that_can_be_laid():
    assert routing.faults() == []


@pytest.mark.parametrize(("file", "old", "new", "said"), [
    ("cutoff_mux.yml", "half of the board, length: 0.22", "half of the board, length: 0.075",
     "W_IN needs 158 mm, the cable has 75"),
    ("routing.yml", "[50, -39.5, 8], [50, -39.5, -4]", "[60, -39.5, 8], [60, -39.5, -4]",
     "W_IMU passes the plate at x 60, y -39.5, where it has no opening"),
    ("routing.yml", "[62, 62, 10], [14, 62, 20]", "[110, 20, 10], [14, 62, 20]",
     "W_LIDAR enters the lidar's rotor"),
    ("routing.yml", "[84, -62, 14]", "[88, -66, 14]",
     "W_USB hangs over the edge of the plate"),
    ("routing.yml", "servo_lead: 1.4", "servo_lead: 3.5",
     "the opening 'hole for cables' of 79 mm2"),
    ("routing.yml", "    W_SERVO:", "    # W_SERVO:", "W_SERVO of minimal.yml has no route"),
])
def test_a_route_that_cannot_be_laid_is_named(copy, file, old, new, said):
    folder = copy(file, old, new)
    assert any(fault.startswith(said) for fault in routing.faults(folder)), routing.faults(folder)
    with pytest.raises(harness.WiringError, match=re.escape(said)):
        plan.drawing("minimal", folder)


def test_an_opening_that_moves_takes_its_cable_along_or_says_so():
    """The picture is drawn from the parameter file: a hole that is gone from there is gone here."""
    moved = copies.deepcopy(P)
    moved.base_holes.cable_x = (90.0, 48.0)
    assert any(fault.startswith("W_IMU passes the plate at x 50, y -39.5")
               for fault in routing.faults(p=moved))
    assert plan.drawing("minimal") != plan.drawing("minimal", p=_shifted())


def _shifted():
    p = copies.deepcopy(P)
    p.base_holes.imu_x = 38.0
    return p


@pytest.mark.parametrize(("old", "new", "said"), [
    ("W_SERVO: [servo,", "W_SERVO: [servos,", "W_SERVO: no place 'servos'; there are infrared"),
    ("W_SERVO: [", "W_SERVOS: [", "has no cable W_SERVOS; it has W_IR"),
])
def test_a_name_that_is_nowhere_says_what_exists(copy, old, new, said):
    with pytest.raises(harness.WiringError, match=said):
        routing.faults(copy("routing.yml", old, new))


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
