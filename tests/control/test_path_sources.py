"""Paths through points, from files and by name, and what cannot be one."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from dart_hal.control.path_file import read_path
from dart_hal.control.paths import Path
from dart_hal.control.tracks import TRACKS, path_of, track_named
from dart_hal.errors import UsageError


def circle(n=40, radius=1.2):
    a = np.linspace(0.0, 2.0 * pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(a), np.sin(a)])


def written(tmp_path, text):
    file = tmp_path / "path.csv"
    file.write_text(text, encoding="utf-8")
    return file


def rows(points, head="x,y"):
    return head + "\n" + "\n".join(",".join(f"{v:.9f}" for v in row) for row in points) + "\n"


def test_a_spline_through_a_circle_is_the_circle():
    path = Path.through(circle(), closed=True)
    assert path.length == pytest.approx(2.0 * pi * 1.2, rel=1e-5)
    assert np.hypot(path.x, path.y) == pytest.approx(np.full(len(path.x), 1.2), abs=1e-5)
    assert path.curvature == pytest.approx(np.full(len(path.x), 1.0 / 1.2), rel=3e-3)
    assert np.diff(path.s) == pytest.approx(path.spacing)


@pytest.mark.parametrize("closed", [True, False])
def test_a_spline_has_no_kink(closed):
    """Heading and curvature are those of the points themselves, over the seam of a closed one."""
    path = Path.through([(0, 0), (1, 0.1), (2, 1), (1, 2), (-0.5, 1)], closed=closed)
    s = np.arange(0.0, path.length * (2 if closed else 1) - 0.02, 0.01)
    spots = np.array([path.at(v) for v in s])
    step = np.diff(spots[:, :2], axis=0)
    turned = np.unwrap(spots[:, 2])
    assert np.hypot(*step.T) == pytest.approx(np.full(len(step), 0.01), rel=0.01)
    assert np.abs(np.diff(turned) / 0.01 - spots[:-1, 3]).max() < 0.2
    assert np.abs(np.diff(spots[:, 3])).max() < 0.2


def test_an_open_path_goes_on_straight_and_a_closed_one_again():
    path = Path([(1.0, 0.0), (0.5 * pi, 1.0)], closed=False)
    x, y, heading, bend = path.at(path.length + 0.5)
    assert (x, y, heading, bend) == pytest.approx((2.0, 1.5, 0.5 * pi, 0.0))
    assert path.curvatures(np.array([-1.0, 0.5, 1.5, 9.0])).tolist() == [0.0, 0.0, 1.0, 0.0]
    ring = Path.through(circle(), closed=True)
    assert ring.at(0.3 + 2 * ring.length)[:2] == pytest.approx(ring.at(0.3)[:2], abs=1e-9)


def test_the_closest_point_is_found_to_a_tenth_of_a_millimetre():
    path = track_named("racetrack_vicon_2")
    rng, near = np.random.default_rng(1), 0.0
    for s in np.arange(0.0, 30.0, 0.37):
        x, y, heading, _ = path.at(s)
        left = float(rng.uniform(-0.3, 0.3))
        near = path.closest(x - left * sin(heading), y + left * cos(heading), near)
        assert near == pytest.approx(s, abs=2e-3)
        assert path.offset(x - left * sin(heading), y + left * cos(heading), near) == \
            pytest.approx(left, abs=1e-4)


def test_a_moved_path_begins_there():
    path = track_named("savoiardo").moved(3.0, -1.0, 2.0)
    assert path.at(0.0)[:3] == pytest.approx((3.0, -1.0, 2.0))
    assert path.at(1.0)[:2] == pytest.approx((3.0 + cos(2.0), -1.0 + sin(2.0)))
    assert path.length == track_named("savoiardo").length


@pytest.mark.parametrize(("name", "length", "size", "radius"), [
    ("racetrack_vicon_2", 22.925, (4.5, 4.5), 0.75), ("racetrack_vicon", 41.1, (7.0, 5.5), 0.5),
    ("savoiardo", 4.8 + 1.6 * pi, (4.0, 1.6), 0.8)])
def test_tracks_of_the_authors(name, length, size, radius):
    path = track_named(name)
    assert path.closed
    assert path.length == pytest.approx(length, abs=1e-3)
    assert (np.ptp(path.x), np.ptp(path.y)) == pytest.approx(size, abs=1e-3)
    assert 1.0 / np.abs(path.curvature).max() == pytest.approx(radius)


def test_a_file_with_speeds(tmp_path):
    points = np.column_stack([circle(), np.linspace(1.0, 2.0, 40)])
    path = path_of(str(written(tmp_path, rows(np.vstack([points, points[:1]]), "x, y,speed"))))
    assert path.closed
    assert path.speed[0] == pytest.approx(1.0)
    assert path.speed.max() == pytest.approx(2.0, abs=0.02)
    assert read_path(written(tmp_path, rows(circle()))).closed is False
    assert read_path(written(tmp_path, rows(circle(), "x,y"))).speed is None


@pytest.mark.parametrize(("text", "match"), [
    ("", "no column x and no column y"),
    ("x,z\n1,2\n", "no column y"),
    ("x,y\n1,2\n2,3\n", "three points"),
    ("x,y\n", "three points"),
    ("x,y\n1,2\n2,nan\n3,3\n", "line 3: y is no number"),
    ("x,y\n1,2\n2\n3,3\n", "line 3: y is no number"),
    ("x,y\n1,2\n2,2\n2,2\n3,1\n", "points 2 and 3 of the path are the same"),
    ("x,y,speed\n1,2,1\n2,2,0\n3,2,1\n", "line 3: speed is no number"),
])
def test_what_is_no_path(tmp_path, text, match):
    file = written(tmp_path, text)
    with pytest.raises(UsageError, match=match) as refused:
        read_path(file)
    assert refused.value.read == str(file)


def test_points_that_are_none():
    with pytest.raises(UsageError, match="point 2 of the path is not finite"):
        Path.through([(0, 0), (1, np.inf), (2, 2)], closed=False)
    with pytest.raises(UsageError, match="points 3 and 1"):
        Path.through([(0, 0), (1, 1), (0, 0)], closed=True)


def test_an_unknown_track_suggests_the_nearest():
    with pytest.raises(UsageError, match="no track is called 'savoyardo'") as refused:
        path_of("savoyardo")
    assert refused.value.remedy.startswith("savoiardo;")
    assert all(name in refused.value.expected for name in TRACKS)
