"""Rings on the main gear: equal marks, as many as the firmware expects, a field that switches."""

from __future__ import annotations

import importlib
import json
import math
import sys

import ezdxf
import numpy as np
import pytest
import trimesh

from dart_hal.wire.messages import PARAMS
from tests.common import HARDWARE, ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

sys.path.append(str(HARDWARE / "cad"))
parameters, outlines, probe = (importlib.import_module(n)
                               for n in ("parameters", "outlines", "probe"))
P = parameters.read()
BUILT = json.loads((HARDWARE / "cad" / "built.json").read_text(encoding="utf-8"))


def flanks(loop: list[tuple[float, float, float]]) -> np.ndarray:
    """Angles [deg] at which the edge of the ring crosses its middle radius, sorted."""
    middle = (P.rings.tip + P.rings.root) / 2
    points = np.array(outlines.sampled(tuple(loop), 0.2))
    radius = np.hypot(*points.T)
    crossing = []
    for i in range(len(points)):
        j = (i + 1) % len(points)
        if (radius[i] - middle) * (radius[j] - middle) < 0:
            share = (middle - radius[i]) / (radius[j] - radius[i])
            x, y = points[i] + share * (points[j] - points[i])
            crossing.append(math.degrees(math.atan2(y, x)) % 360)
    return np.sort(crossing)


def sectors(loop: list[tuple[float, float, float]]) -> np.ndarray:
    """Angles between neighbouring flanks, deg."""
    at = flanks(loop)
    return np.diff(np.append(at, at[0] + 360))


def read_striped_ring() -> list[tuple[float, float, float]]:
    space = ezdxf.readfile(HARDWARE / "dxf" / "striped_ring.dxf").modelspace()
    return next(list(e.get_points("xyb")) for e in space if e.dxftype() == "LWPOLYLINE")


def test_teeth_and_gaps_are_equal():
    assert sectors(read_striped_ring()) == pytest.approx(18.0, abs=0.05)


def test_a_tooth_of_19_degrees_is_found():
    """The control: one flank turned by 1.3 deg, as in a drawing known to be uneven."""
    loop = read_striped_ring()
    turn = math.radians(1.3)
    for i in (1, 2):  # both ends of one flank
        x, y, bulge = loop[i]
        loop[i] = (x * math.cos(turn) - y * math.sin(turn),
                   x * math.sin(turn) + y * math.cos(turn), bulge)
    assert np.abs(sectors(loop) - 18.0).max() == pytest.approx(1.3, abs=0.05)


def test_mesh_and_drawing_of_the_striped_ring_agree():
    body = trimesh.load_mesh(HARDWARE / "stl" / "striped_ring.stl")
    radius = np.hypot(*body.vertices[:, :2].T)
    outer = body.vertices[radius > P.rings.tip - 0.01]
    angle = np.degrees(np.arctan2(outer[:, 1], outer[:, 0])) % 36
    assert (np.minimum(angle, 36 - angle) < 9.01).all(), "tips lie within 9 deg of each tooth"
    assert radius.min() == pytest.approx((P.gear.hub + P.gear.hub_play) / 2, abs=0.01)


def edges_of_the_firmware() -> tuple[int, int]:
    default = {param.name: param.default for param in PARAMS}
    return default["edges_per_rev_a"], default["edges_per_rev_b"]


def magnets() -> np.ndarray:
    """Centres of the magnets' holes, shape (n, 2), mm; each is checked in the mesh."""
    body = trimesh.load_mesh(HARDWARE / "stl" / "magnet_ring.stl")
    holes = [h for h in BUILT["parts"]["magnet_ring"]["holes"] if h["use"] == "magnet"]
    assert max(probe.hole_error(body, h) for h in holes) < 0.02
    return np.array([h["at"][:2] for h in holes])


def test_counts_are_those_of_firmware_and_car():
    """Both flanks of each mark count."""
    ring_a, ring_b = edges_of_the_firmware()
    assert len(flanks(read_striped_ring())) == ring_a
    assert 2 * len(magnets()) == ring_b
    for file in sorted((ROOT / "cars").glob("*/car.toml")):
        encoder = tomllib.loads(file.read_text(encoding="utf-8"))["encoder"]
        assert encoder["edges_per_rev"] == len(flanks(read_striped_ring())), file.parent.name


def test_a_lost_tooth_is_counted():
    loop = read_striped_ring()
    assert len(flanks(loop[4:])) == edges_of_the_firmware()[0] - 2


def test_magnets_are_equal_and_concentric():
    at = magnets()
    assert np.hypot(*at.T) == pytest.approx(P.rings.magnet_radius, abs=0.01)
    angle = np.sort(np.degrees(np.arctan2(at[:, 1], at[:, 0])) % 360)
    assert np.diff(np.append(angle, angle[0] + 360)) == pytest.approx(72.0, abs=0.1)


def field(distance: float, magnets: int = 1, remanence: float = 1.2) -> float:
    """Flux density [mT] on the axis of stacked discs of 2 x 1 mm, at a distance [mm]."""
    r = 1.0
    length = float(magnets)
    return 500 * remanence * ((distance + length) / math.hypot(r, distance + length)
                              - distance / math.hypot(r, distance))


def test_the_field_at_the_gap_switches_the_hall_sensor():
    """The A3144E operates at 35 mT at worst [data sheet]; known figures pin the formula."""
    assert [round(field(z)) for z in (1, 2, 3)] == [112, 33, 13]
    assert [round(field(z, 2)) for z in (1, 2, 3)] == [145, 45, 19]
    assert field(P.hall.air_gap) > 35
    assert field(P.raw["hall"]["air_gap"]["max"]) > 35
    assert field(2.5) < 35, "the control"


def test_the_switch_looks_at_the_circle_of_the_magnets():
    """Both placed in the car: same distance from the shaft, gap as required."""
    place = {q["name"]: np.array(q["matrix"]) for q in BUILT["placements"]}
    shaft = place["striped_ring"][:3, 3]
    item = next(i for i in BUILT["items"] if i["name"] == "hall_sensor")["shapes"][0]
    low = np.array(item["low"])
    high = np.array(item["high"])
    middle = (low + high) / 2
    ring = np.append(magnets(), np.full((P.rings.magnets, 1), BUILT["parts"]["magnet_ring"]
                                        ["box_mm"][1][2]), axis=1)
    faces = ring @ place["magnet_ring"][:3, :3].T + place["magnet_ring"][:3, 3]
    assert np.linalg.norm(middle[1:] - shaft[1:]) == pytest.approx(P.rings.magnet_radius)
    assert np.linalg.norm(faces[:, 1:] - middle[1:], axis=1).min() < 0.05
    assert faces[0, 0] - high[0] == pytest.approx(P.hall.air_gap)
