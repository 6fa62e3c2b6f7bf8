"""``dart-hal follow``: what it prints, draws, records and refuses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.cli import follow as verb_module
from dart_hal.cli.follow import (
    MIN_KEY_SPEED,
    apply_keys,
    are_poses_silent,
    describe_missing_pose,
)
from dart_hal.control.follow import Follower, Phase
from dart_hal.control.tracks import track_named
from dart_hal.core.types import Pose, Tracking, pose_cov
from dart_hal.estimation.localisation.health import Status
from dart_hal.fleet.peers import OtherPose
from dart_hal.recording.run import RunReader
from studies.control.light_follow import LATER, plant_by

pytestmark = pytest.mark.usefixtures("armed_esc")
URL = "sim://?seed=3&nano=mock&mocap=1"


def csv(tmp_path, points):
    file = tmp_path / "path.csv"
    file.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in points))
    return file


@pytest.fixture
def bend(tmp_path):
    """3 m, by 0.4 m to the left."""
    x = np.linspace(0.0, 3.0, 13)
    return csv(tmp_path, np.column_stack([x, 0.4 * (x / 3.0) ** 2]))


@pytest.mark.slow
def test_a_drive_is_driven_recorded_and_drawn(verb, tmp_path, bend):
    run = tmp_path / "run.mcap"
    picture = tmp_path / "run.png"
    done = verb("follow", bend, "--speed", 1, "--here", "--url", URL, "--record", run, "--plot",
                picture, "--json")
    assert done.code == 0, done.err
    summary = done.json["summary"]
    assert summary["ended"] == "the path is driven"
    assert summary["length_m"] == pytest.approx(3.03, abs=0.02)
    assert summary["offset_max_m"] < 0.3
    assert done.json["files"].keys() == {"recording", "plot"}
    assert picture.stat().st_size > 10_000
    assert "begins at 0.00 m of 3.0" in done.err
    assert "no model.toml" in done.err
    assert {"follow/s", "follow/offset", "follow/speed"} <= {
        row.name for row in RunReader(run).logged()}


@pytest.mark.slow
@pytest.mark.parametrize(("guard", "ended", "walls_passed"), [
    (("--guard-distance", 0.4), "an obstacle has been before the car for 3 s", False),
    ((), "the time of 7 s is over", True)], ids=["guarded", "control"])
def test_with_a_guard_distance_it_stops_before_a_wall(verb, tmp_path, guard, ended, walls_passed):
    path = csv(tmp_path, [(x, 0.0) for x in range(20)])
    done = verb("follow", path, "--speed", 1, "--here", "--duration", 7, "--json", *guard, "--url",
                f"{URL}&lidar=1&map=room&physics=kinematic")
    assert done.json["summary"]["ended"] == ended
    assert (done.json["summary"]["distance_m"] > 3.5) == walls_passed


@pytest.mark.slow
def test_out_of_time_it_stops_and_reports_it(verb, bend):
    done = verb("follow", bend, "--speed", 0.5, "--odometry", "--duration", 1,
                "--url", "sim://?seed=3&nano=mock")
    assert done.code == 0, done.err
    assert "ended: the time of 1 s is over" in done.out


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "plans"), [(("--profile",), True), (("--speed", 1), False),
                                              (("--profile", "--tracker", "lqr"), False)])
def test_at_the_limit_of_the_tyres_the_default_tracker_plans(verb, bend, speed, plans):
    done = verb("follow", bend, *speed, "--here", "--duration", 0.5, "--url", URL, "--json")
    assert done.code == 0, done.err
    assert ("plans" in done.json["summary"]) is plans


@pytest.mark.slow
def test_without_a_pose_it_does_not_drive(verb, bend):
    done = verb("follow", bend, "--speed", 1, "--url", "sim://?nano=mock")
    assert done.code == 1
    assert "no pose came within 5 s: motion capture is silent" in done.out


@pytest.mark.parametrize(("arguments", "message"), [
    (("savoyardo", "--speed", 1), "savoiardo;"),
    (("savoiardo",), "one speed is required"),
    (("savoiardo", "--speed", 1, "--profile"), "one speed is required"),
    (("savoiardo", "--speed", 1, "--raceline", 0.9), "lane of this width"),
    (("racetrack_vicon", "--speed", 1), "tighter than the car turns"),
    (("racetrack_vicon", "--speed", 1, "--tracker", "mpcc"), "tighter than the car turns"),
    (("nothing.csv", "--speed", 1), "nothing.csv"),
    (("savoiardo", "--speed", 1, "--obstacle", "1,0,0.1"), "add --tracker mpcc to --obstacle"),
    (("savoiardo", "--speed", 1, "--compiled"), "add --tracker mpcc to --compiled"),
    (("savoiardo", "--speed", 1, "--tracker", "ca-mpcc", "--compiled"), "ca-mpcc has no --c"),
    (("savoiardo", "--speed", 1, "--tracker", "mpcc", "--weights", "tuned"), "mpcc has no --w"),
    (("savoiardo", "--speed", 1, "--tracker", "ca-mpcc", "--lane", 0.9), "a lane of 0.40 m"),
    (("savoiardo", "--speed", 1, "--tracker", "mpcc", "--obstacle", "1,0"), "not X,Y,R"),
    (("savoiardo", "--speed", 1, "--tracker", "mpcc", "--obstacle", "1,0,-1"), "must be above 0 m"),
    (("savoiardo", "--speed", 1, "--minimum-time"), "needs a lane for the line"),
    (("savoiardo", "--speed", 1, "--detect-cars"), "add --poses lidar:MAP.yaml"),
    (("savoiardo", "--speed", 1, "--room-key", "k"), "--room-key needs --room"),
    (("savoiardo", "--speed", 1, "--odometry", "--poses", "udp://:5005"), "uses no poses"),
])
@pytest.mark.slow_except("arguments[0-46-9]*", "arguments1[0-3]*")
def test_what_cannot_be(verb, arguments, message):
    done = verb("follow", *arguments, "--url", URL)
    assert done.code == 2
    assert message in done.err


@pytest.mark.slow
def test_obstacles_are_passed_and_the_distance_to_them_reported(verb, tmp_path):
    """The one at 1.8 m leaves a passage, the one behind the end is never met."""
    line = csv(tmp_path, [(0.3 * k, 0.0) for k in range(15)])
    run = tmp_path / "run.mcap"
    done = verb("follow", line, "--speed", 1, "--here", "--odometry", "--tracker", "mpcc",
                "--obstacle", "2.4,-0.15,0.15", "--obstacle", "9,0.1,0.1", "--record", run, "--url",
                "sim://?seed=3&nano=mock", "--plot", tmp_path / "run.png", "--json")
    assert done.code == 0, done.err
    summary = done.json["summary"]
    near, far = (row["air_m"] for row in summary["obstacles"])
    assert 0.05 < near < 0.14
    assert far > 3.0
    assert summary["plans"]["SOLVED"] > 30
    assert "plan/std" in {row.name for row in RunReader(run).logged()}


class Silent:
    """A member of a room in which a car at (3.5, 0) of the odometry's frame fell silent."""

    def __init__(self, car, room, **options):
        red = OtherPose("red", 60.0, True, Pose(3.5, 0.0, 0.0, pose_cov(0.01, 0.01)), "start", 0.0,
                        0.0, Tracking.TRACKING)
        self.other_poses = lambda: {"red": red}
        self.plans = []

    def tell_plan(self, points, **of):
        self.plans.append(points)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


@pytest.mark.slow
def test_a_neighbour_that_never_answers_is_waited_for_counted_and_recorded(verb, tmp_path,
                                                                           monkeypatch):
    monkeypatch.setattr(verb_module, "join", Silent)
    line = csv(tmp_path, [(0.3 * k, 0.0) for k in range(30)])
    run = tmp_path / "run.mcap"
    done = verb("follow", line, "--speed", 1, "--here", "--odometry", "--tracker", "mpcc", "--room",
                "local://lab", "--duration", 6, "--record", run, "--url",
                "sim://?seed=3&nano=mock", "--json")
    assert done.code == 0, done.err
    summary = done.json["summary"]
    assert summary["others"] == ["red"]
    assert summary["waited_s"]["LOST"] > 2.0
    rows = {row.name: row for row in RunReader(run).logged()}
    assert {"traffic/room", "traffic/wait", "plan/outcome"} <= rows.keys()


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["tuned", "published"])
def test_the_two_layers_drive_past_an_obstacle(verb, tmp_path, weights):
    line = csv(tmp_path, [(0.3 * k, 0.0) for k in range(15)])
    run = tmp_path / "run.mcap"
    done = verb("follow", line, "--speed", 1, "--here", "--odometry", "--tracker", "ca-mpcc",
                "--weights", weights, "--obstacle", "2.4,-0.15,0.15", "--record", run, "--url",
                "sim://?seed=3&nano=mock", "--plot", tmp_path / "run.png", "--json")
    assert done.code == 0, done.err
    summary = done.json["summary"]
    assert summary["obstacles"][0]["air_m"] > 0.05
    assert summary["plans"]["SOLVED"] > 30
    assert {"plan/std", "plan/x"} <= {row.name for row in RunReader(run).logged()}


def test_an_obstacle_without_a_way_past_it_is_refused(verb, tmp_path):
    line = csv(tmp_path, [(0.3 * k, 0.0) for k in range(15)])
    done = verb("follow", line, "--speed", 1, "--odometry", "--tracker", "mpcc", "--obstacle",
                "2.4,0.05,0.15", "--url", "sim://?seed=3&nano=mock")
    assert done.code == 2
    assert "obstacle 1 leaves no passage within the lane" in done.err


def test_a_car_that_starts_elsewhere(verb, tmp_path):
    there = csv(tmp_path, [(9.0, 9.0), (10.0, 9.0), (11.0, 9.0)])
    done = verb("follow", there, "--speed", 1, "--url", URL)
    assert done.code == 2
    assert "m away from the path" in done.err
    assert "--here" in done.err


def test_laps_of_an_open_path(verb, bend):
    done = verb("follow", bend, "--speed", 1, "--laps", 2, "--url", URL)
    assert done.code == 2
    assert "repeat the first row of the file as its last" in done.err


def test_keys_change_the_speed_and_end_the_drive():
    class Keys:
        def __init__(self, typed):
            self.keys = lambda: typed

    follower = Follower(track_named("savoiardo"), plant_by(LATER), 1.0)
    apply_keys(None, follower)
    apply_keys(Keys(b"++x-+"), follower)
    assert follower.cap == pytest.approx(1.2)
    apply_keys(Keys(b"-" * 30), follower)
    assert follower.cap == MIN_KEY_SPEED
    assert follower.phase is Phase.WAITING
    apply_keys(Keys(b"q"), follower)
    assert follower.phase is Phase.STOPPING


def make_car(localiser=None, located=False, lidar=True):
    """The parts of a car that state why it has no pose."""
    return SimpleNamespace(has_lidar=lidar,
                           lidar=SimpleNamespace(localiser=localiser, located=located))


def test_why_there_is_no_pose_is_named_with_the_remedy():
    ambiguous, lost = (make_car(SimpleNamespace(newest=SimpleNamespace(status=status)))
                       for status in (Status.AMBIGUOUS, Status.LOST))
    assert "start=X,Y,YAW" in describe_missing_pose(ambiguous)
    assert "is it of this room?" in describe_missing_pose(lost)
    assert describe_missing_pose(make_car(SimpleNamespace(newest=None))) == ""
    for by_motion_capture in (make_car(lidar=False), make_car(None)):
        assert "--odometry" in describe_missing_pose(by_motion_capture)


def test_scans_that_fit_no_map_are_no_silence():
    assert are_poses_silent(make_car(lidar=False)), "motion capture"
    assert are_poses_silent(make_car(None)), "motion capture, and a lidar for other things"
    assert are_poses_silent(make_car(SimpleNamespace(), located=True))
    assert not are_poses_silent(make_car(SimpleNamespace(), located=False))
