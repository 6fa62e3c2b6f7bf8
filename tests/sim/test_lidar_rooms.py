"""Rays against lines, the rooms of the simulated lidar, and maps of map_server as rooms."""

from __future__ import annotations

import sys
from math import cos, hypot, pi, sin, tau

import numpy as np
import pytest
from PIL import Image

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation import rays
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.vehicle.native.build import compiler
from dart_lab.sim.lidar import lanes
from dart_lab.sim.lidar.maps import ROOMS, box, clearance, room_of
from dart_lab.sim.truth import reveal_url, room_of_car

CASTS = [rays.cast_numpy, *([rays.native_cast()] if rays.native_cast() else [])]


def directions(n):
    turn = np.linspace(0.0, tau, n, endpoint=False)
    return np.column_stack((np.cos(turn), np.sin(turn)))


@pytest.mark.parametrize("cast", CASTS)
def test_rays_in_a_box_and_past_it(cast):
    lines = box(1.0, 0.5, 0.0, 4.0, 3.0)
    way = np.array(((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)))
    assert cast(lines, np.zeros((4, 2)), way) == pytest.approx([3.0, 1.0, 2.0, 1.0])
    outside = cast(lines, np.full((4, 2), (-5.0, 0.0)), way)
    assert outside[0] == pytest.approx(4.0)
    assert (outside[1:] == rays.NO_HIT).all()
    assert (cast(np.empty((0, 4)), np.zeros((4, 2)), way) == rays.NO_HIT).all()


@pytest.mark.parametrize("cast", CASTS)
def test_no_ray_slips_through_a_corner(cast):
    ring = np.array([(cos(a), sin(a)) for a in np.linspace(0.0, tau, 50, endpoint=False)])
    lines = np.hstack((ring, np.roll(ring, -1, axis=0)))
    way = ring / np.linalg.norm(ring, axis=1)[:, None]
    assert cast(lines, np.zeros_like(way), way) == pytest.approx(np.ones(50), abs=1e-9)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_kernel_agrees_with_numpy():
    assert rays.native_cast() is not None, "rays.c does not compile, or differs"
    for name in ROOMS:
        lines = room_of(name, 5).lines
        origin = np.random.default_rng(2).uniform(-1.0, 6.0, (500, 2))
        assert rays.native_cast()(lines, origin, directions(500)) == pytest.approx(
            rays.cast_numpy(lines, origin, directions(500)), rel=1e-9, abs=1e-9)


def test_numpy_alone_does_where_the_kernels_are_switched_off(monkeypatch):
    monkeypatch.setenv("DART_HAL_NATIVE", "0")
    rays.native_cast.cache_clear()
    try:
        assert rays.fastest_cast() is rays.cast_numpy
    finally:
        rays.native_cast.cache_clear()


@pytest.mark.parametrize("name", list(ROOMS))
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5])
def test_a_room_is_closed_and_its_start_is_free(name, seed):
    room = room_of(name, seed)
    everything = np.vstack((room.lines, room.glass))
    x, y, _ = room.start
    free = {"track": 0.34, "corridor": 0.69, "hall": 0.34, "room": 1.0}
    in_lane = lanes.LANE_HALF_WIDTH - lanes.MAX_START_OFFSET - 0.01
    assert clearance(everything, x, y) > free.get(name, in_lane)
    reach = rays.cast_numpy(everything, np.full((720, 2), (x, y)), directions(720))
    assert reach.max() < 18.0, "a ray leaves the room"


def test_another_seed_is_another_room_and_the_same_is_the_same():
    assert (room_of("room", 1).lines == room_of("room", 1).lines).all()
    assert (room_of("room", 1).lines != room_of("room", 2).lines).any()


GRID = np.full((40, 60), 254, np.uint8)
GRID[[0, -1], :] = GRID[:, [0, -1]] = 0
GRID[10:14, 30:36] = 0   # counted from the top, as a picture
GRID[20:24, 5:9] = 205   # not known


def write_map(folder, origin="[-1.0, -0.5, 0.0]", head=b"P5\n# made by hand\n60 40\n255\n"):
    (folder / "hall.pgm").write_bytes(head + GRID.tobytes())
    path = folder / "hall.yaml"
    path.write_text(f"image: hall.pgm\nresolution: 0.05\norigin: {origin}\nnegate: 0\n"
                    "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    return path


def test_a_map_of_map_server_has_walls_at_the_middles_of_its_cells(tmp_path):
    path = write_map(tmp_path)
    room = room_of(str(path), 1)
    assert len(room.lines) == 4 + 6 + 4  # the wall of one cell; columns and rows of the block
    length = np.hypot(*(room.lines[:, 2:] - room.lines[:, :2]).T).sum()
    assert length == pytest.approx(0.05 * (2 * (59 + 39) + 6 * 3 + 4 * 5))
    grid = read_grid(path)
    x, y, _ = room.start
    assert grid.is_free(x, y)
    # the block: columns 30 to 36, rows 26 to 30 from the bottom
    block = rays.cast_numpy(room.lines, np.array(((-0.5, 0.9),)), np.array(((1.0, 0.0),)))
    assert block[0] == pytest.approx(-1.0 + 30.5 * 0.05 + 0.5)


YAML = ("image: hall.pgm\nresolution: 0.05\norigin: [-1.0, -0.5, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n")


@pytest.mark.parametrize("text", [
    YAML.replace("[-1.0, -0.5, 0.0]", "\n- -1.0\n- -0.5\n- 0.0"),
    YAML.replace("hall.pgm", "hall.pgm  # cleaned up"),
    YAML.replace("hall.pgm", '"hall.pgm"').replace("\n", "\r\n"),
    "%YAML 1.1\n---\n" + YAML + "mode: trinary\n",
    "# map\n" + YAML.replace("negate: 0", "negate: no"),
    "{" + YAML.strip().replace("\n", ", ") + "}"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_map_file_is_read_as_yaml(tmp_path, text, encoding):
    path = write_map(tmp_path)
    expected = read_grid(path)
    path.write_bytes(text.encode(encoding))
    grid = read_grid(path)
    assert np.array_equal(grid.occupied, expected.occupied)
    assert (grid.cell, *grid.origin) == (0.05, -1.0, -0.5)


@pytest.mark.parametrize("text", [
    "", "- 1\n", "image: [", "&a [*a]", YAML + "mode: raw\n", YAML.replace("0.05", "wide"),
    YAML.replace("[-1.0, -0.5, 0.0]", "3"), "image: hall.pgm\n", "[" * 5000,
    YAML.replace("hall.pgm", "hall.yaml"), YAML.replace("hall.pgm", "other.png")])
def test_yaml_that_is_no_map_is_refused(tmp_path, text):
    path = write_map(tmp_path)
    path.write_text(text)
    with pytest.raises(UsageError, match=r"hall\.yaml"):
        read_grid(path)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "LA", "I;16", "1"])
def test_map_image_may_be_a_png(tmp_path, mode):
    path = write_map(tmp_path)
    expected = read_grid(path)
    picture = Image.fromarray(GRID)
    picture = (Image.fromarray(GRID.astype(np.uint16) * 257) if mode == "I;16"
               else picture.convert(mode, dither=0))
    picture.save(tmp_path / "hall.png")
    path.write_text(YAML.replace("hall.pgm", "hall.png"))
    grid = read_grid(path)
    assert np.array_equal(grid.occupied, expected.occupied)
    assert mode == "1" or np.array_equal(grid.free, expected.free)  # one bit knows no third shade


def test_png_map_without_pillow_names_the_remedy(tmp_path, monkeypatch):
    path = write_map(tmp_path)
    Image.fromarray(GRID).save(tmp_path / "hall.png")
    path.write_text(YAML.replace("hall.pgm", "hall.png"))
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(UsageError, match="needs Pillow") as refused:
        read_grid(path)
    assert "pillow" in refused.value.remedy


def test_a_car_drives_in_a_map_of_ones_own(tmp_path):
    backend = open_backend(f"sim://?seed=1&nano=mock&lidar=1&map={write_map(tmp_path)}")
    assert room_of_car(backend).name == "hall"
    backend.close()


@pytest.mark.parametrize("how", [
    {"origin": "[0, 0, 0.3]"}, {"origin": "[0, 0]"}, {"head": b"P2\n60 40\n255\n"},
    {"head": b"P5\n600 400\n255\n"}])
def test_a_map_that_cannot_be_used_is_refused_by_name(tmp_path, how):
    with pytest.raises(UsageError, match=r"hall\.yaml"):
        room_of(str(write_map(tmp_path, **how)), 1)


def test_a_map_that_is_not_there_is_refused():
    with pytest.raises(UsageError, match="no map"):
        room_of("nowhere.yaml", 1)


def test_only_the_truth_shows_the_room():
    shown = reveal_url(Url.parse("sim://?seed=2&lidar=noise=0&map=room"))
    assert shown["lidar"]["noise"] == 0.0
    assert shown["lidar"]["scale"] != 1.0
    assert shown["room"]["lines"] == room_of("room", 2).lines.tolist()
    x, y, yaw = shown["room"]["start"]
    assert hypot(x, y) > 0.0
    assert -pi <= yaw <= pi
    without = reveal_url(Url.parse("sim://?seed=2"))
    assert (without["lidar"], without["room"]) == (None, None)
