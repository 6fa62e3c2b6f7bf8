"""Paths through points, from files and by name, and what cannot be one."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from dart_hal.control.path_file import read_path
from dart_hal.control.paths import Path
from dart_hal.control.tracks import TRACKS, track_named
from dart_hal.core.errors import UsageError


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
    spots = np.array([path.interpolate(v) for v in s])
    step = np.diff(spots[:, :2], axis=0)
    turned = np.unwrap(spots[:, 2])
    assert np.hypot(*step.T) == pytest.approx(np.full(len(step), 0.01), rel=0.01)
    assert np.abs(np.diff(turned) / 0.01 - spots[:-1, 3]).max() < 0.2
    assert np.abs(np.diff(spots[:, 3])).max() < 0.2


def test_an_open_path_goes_on_straight_and_a_closed_one_again():
    path = Path([(1.0, 0.0), (0.5 * pi, 1.0)], closed=False)
    x, y, heading, bend = path.interpolate(path.length + 0.5)
    assert (x, y, heading, bend) == pytest.approx((2.0, 1.5, 0.5 * pi, 0.0))
    assert path.curvatures(np.array([-1.0, 0.5, 1.5, 9.0])).tolist() == [0.0, 0.0, 1.0, 0.0]
    ring = Path.through(circle(), closed=True)
    assert ring.interpolate(0.3 + 2 * ring.length)[:2] == pytest.approx(
        ring.interpolate(0.3)[:2], abs=1e-9)


def test_the_closest_point_is_found_to_a_tenth_of_a_millimetre():
    path = track_named("racetrack_vicon_2")
    rng = np.random.default_rng(1)
    near = 0.0
    for s in np.arange(0.0, 30.0, 0.37):
        x, y, heading, _ = path.interpolate(s)
        left = float(rng.uniform(-0.3, 0.3))
        near = path.closest(x - left * sin(heading), y + left * cos(heading), near)
        assert near == pytest.approx(s, abs=2e-3)
        assert path.offset(x - left * sin(heading), y + left * cos(heading), near) == \
            pytest.approx(left, abs=1e-4)


def test_a_moved_path_begins_there():
    path = track_named("savoiardo").moved(3.0, -1.0, 2.0)
    assert path.interpolate(0.0)[:3] == pytest.approx((3.0, -1.0, 2.0))
    assert path.interpolate(1.0)[:2] == pytest.approx((3.0 + cos(2.0), -1.0 + sin(2.0)))
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
    path = track_named(str(written(tmp_path, rows(np.vstack([points, points[:1]]), "x, y,speed"))))
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
    ("x,y,Speed\n1,2,1\n2,2,1\n3,2,1\n", "column Speed looks like a speed"),
    ("x,y,v\n1,2,1\n2,2,1\n3,2,1\n", "column v looks like a speed"),
    ("x,y,speed_kmh\n1,2,1\n2,2,1\n3,2,1\n", "column speed_kmh looks like a speed"),
    ("x,y\n0,0\n1,0\n0,0\n", "the path turns back at point 2"),
    ("x,y\n0,0\n1,0\n2,0\n1,0.0001\n0,0\n", "the path turns back at point 3"),
])
def test_what_is_no_path(tmp_path, text, match):
    file = written(tmp_path, text)
    with pytest.raises(UsageError, match=match) as refused:
        read_path(file)
    assert refused.value.read == str(file)


@pytest.mark.parametrize(("closed", "remedy"), [(True, "leave the last point out"),
                                                (False, "remove one")])
def test_points_that_repeat_state_which_one_to_leave_out(closed, remedy):
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    points = [*corners, corners[0 if closed else -1]]
    with pytest.raises(UsageError, match="are the same") as refused:
        Path.through(points, closed=closed)
    assert remedy in str(refused.value)


def square(side=4.0, n=80):
    """Points of a rounded square, not repeated at its end."""
    a = np.linspace(0.0, 2.0 * pi, n, endpoint=False)
    r = 0.5 * side / (np.cos(a) ** 4 + np.sin(a) ** 4) ** 0.25
    return np.column_stack([r * np.cos(a), r * np.sin(a)])


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_path_file_is_read_in_every_encoding(tmp_path, encoding, newline):
    file = tmp_path / "path.csv"
    file.write_bytes(rows(circle()).replace("\n", newline).encode(encoding))
    assert read_path(file).length == pytest.approx(2.0 * pi * 1.2 * 39 / 40, rel=1e-3)


def test_path_file_in_another_encoding_is_refused(tmp_path):
    file = tmp_path / "path.csv"
    file.write_bytes("x,y,größe\n1,2,3\n".encode("latin-1"))
    with pytest.raises(UsageError, match="not a text file") as refused:
        read_path(file)
    assert "UTF-8" in refused.value.remedy


@pytest.mark.parametrize("separator", [", ", ",", "; ", ";", "\t"])
def test_centre_line_of_f1tenth_is_a_closed_path(tmp_path, separator):
    head = "# x_m, y_m, w_tr_right_m, w_tr_left_m".replace(", ", separator)
    body = [separator.join(f"{v:.7f}" for v in (*row, 1.1, 1.1)) for row in square(20.0)]
    path = read_path(written(tmp_path, "\n".join([head, *body]) + "\n"))
    assert path.closed
    assert path.speed is None
    assert np.ptp(path.x) == pytest.approx(20.0, rel=0.01)


@pytest.mark.parametrize("repeated", [True, False])
def test_raceline_of_tum_is_a_closed_path_with_speeds(tmp_path, repeated):
    head = ["# 4bd8b12f-6c2e-4d1e-8c5e-0f9a8f4e2e11", "# 31e2a4",
            "# s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2"]
    points = square(30.0)
    points = np.vstack([points, points[:1]]) if repeated else points
    body = ["; ".join(f"{v:.7f}" for v in (0.4 * i, *row, 0.1, 0.2, 5.0 + 0.01 * i, 0.0))
            for i, row in enumerate(points)]
    path = track_named(str(written(tmp_path, "\n".join([*head, *body]) + "\n")))
    assert path.closed
    assert path.speed[0] == pytest.approx(5.0)
    assert np.ptp(path.y) == pytest.approx(30.0, rel=0.01)


def test_an_open_track_stays_open(tmp_path):
    body = [", ".join(f"{v:.4f}" for v in (*row, 1.1, 1.1)) for row in square(20.0)[:60]]
    assert not read_path(written(tmp_path, "\n".join(["# x_m, y_m, a, b", *body]))).closed


def test_comments_in_a_path_of_ones_own_are_skipped(tmp_path):
    text = "# made by hand\nx,y\n0,0\n# corner\n1,0\n\n2,1\n"
    assert read_path(written(tmp_path, text)).length == pytest.approx(2.5, abs=0.1)
    with pytest.raises(UsageError, match="line 5: y is no number"):
        read_path(written(tmp_path, "# made by hand\nx,y\n0,0\n# corner\n1,a\n2,1\n"))


@pytest.mark.parametrize(("head", "scale"), [("x_cm,y_cm", 0.01), ("x_mm,y_mm", 0.001)])
def test_unit_of_the_header_is_used(tmp_path, head, scale):
    path = read_path(written(tmp_path, rows(circle() / scale, head)))
    assert np.ptp(path.x) == pytest.approx(2.4, abs=0.01)


def test_path_in_centimetres_is_questioned(tmp_path):
    """A circle of 1.2 m in centimetres is 240 wide; x_m, y_m accepts what is that large."""
    with pytest.raises(UsageError, match="in metres") as refused:
        read_path(written(tmp_path, rows(100.0 * circle())))
    assert "x_cm,y_cm" in refused.value.remedy
    assert read_path(written(tmp_path, rows(100.0 * circle(), "x_m,y_m"))).length > 700.0


def test_points_that_are_none():
    with pytest.raises(UsageError, match="point 2 of the path is not finite"):
        Path.through([(0, 0), (1, np.inf), (2, 2)], closed=False)
    with pytest.raises(UsageError, match="points 3 and 1"):
        Path.through([(0, 0), (1, 1), (0, 0)], closed=True)


def test_an_unknown_track_suggests_the_nearest():
    with pytest.raises(UsageError, match="no track is called 'savoyardo'") as refused:
        track_named("savoyardo")
    assert refused.value.remedy.startswith("savoiardo;")
    assert all(name in refused.value.expected for name in TRACKS)
