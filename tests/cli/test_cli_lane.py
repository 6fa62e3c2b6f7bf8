"""``dart-hal lane``: what it prints, draws and refuses."""

from __future__ import annotations

import pytest

from dart_hal.recording.run import RunReader

pytestmark = pytest.mark.usefixtures("armed_esc")
URL = "sim://?seed=3&nano=mock&lidar=1&map=lane-s"


@pytest.mark.slow
def test_a_lane_is_driven_recorded_and_drawn(verb, tmp_path):
    run = tmp_path / "run.mcap"
    picture = tmp_path / "run.png"
    done = verb("lane", "--distance", 3, "--url", URL, "--record", run, "--plot", picture, "--json")
    assert done.code == 0, done.err
    summary = done.json["summary"]
    assert summary["ended"] == "3 m are driven"
    assert summary["half_width_m"] == pytest.approx(0.4, abs=0.02)
    assert summary["offset_max_m"] < 0.15
    assert done.json["files"].keys() == {"recording", "plot"}
    assert picture.stat().st_size > 10_000
    assert "a lane 8" in done.err or "a lane 7" in done.err
    assert {"lane/offset", "lane/half_width", "lane/speed", "lane/trim"} <= {
        row.name for row in RunReader(run).logged()}


@pytest.mark.slow
def test_where_there_is_no_lane_it_does_not_drive(verb):
    """A room whose walls are far away."""
    done = verb("lane", "--url", "sim://?seed=1&nano=mock&lidar=most=0.2&map=lane")
    assert done.code == 1
    assert "no boards are visible within 5 s" in done.out


@pytest.mark.parametrize(("url", "message"), [
    ("sim://?nano=mock", "has no lidar"),
    ("replay://nothing.mcap", "nothing.mcap")])
def test_what_cannot_be(verb, url, message):
    done = verb("lane", "--url", url)
    assert done.code == 2
    assert message in done.err
