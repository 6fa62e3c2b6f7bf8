"""A drive along a path: where it may begin, how it ends, and its messages."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from dart_hal.control.follow import (
    MAX_BRIDGED_GAP,
    MAX_JOIN_DISTANCE,
    MAX_POSE_GAP,
    MAX_START_WAIT,
    Follower,
    Phase,
    Rules,
    find_start,
)
from dart_hal.control.paths import Path
from dart_hal.control.stopping import REST_SPEED, STUCK_TIME
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import START_FRAME, Pose, Tracking
from dart_hal.vehicle.sets import UPSTREAM_2024
from studies.control.light_follow import light_drive, motion_at, plant_by

PLANT = plant_by(UPSTREAM_2024)
STRAIGHT = Path([(4.0, 0.0)], closed=False)
LONG = Path([(9.0, 0.0)], closed=False)


def drive(path=STRAIGHT, rules=None, cap=1.0, **options):
    """(follower, rows) of a drive that has ended at rest."""
    follower = Follower(path, PLANT, cap, "lqr", rules or Rules())
    rows = light_drive(follower, UPSTREAM_2024, **options)
    assert follower.phase is Phase.ENDED
    assert abs(rows[-1, 4]) < REST_SPEED
    return follower, rows


def make_tracking_hook(t, t_change, tracking=Tracking.LOST):
    """A hook that reports ``t`` from ``t_change`` s on."""
    def each(now, follower, motion):
        return replace(motion, tracking=tracking) if now > t_change else motion
    return each


@pytest.mark.slow
def test_an_open_path_ends_at_its_end_at_rest():
    follower, rows = drive()
    assert follower.good
    assert follower.why == "the path is driven"
    assert rows[-1, 1] == pytest.approx(4.0, abs=0.06)
    assert rows[:, 4].max() == pytest.approx(1.0, abs=0.05)
    assert np.diff(rows[:, 5]).min() > -0.25


@pytest.mark.slow
def test_laps_are_counted_and_timed():
    follower, _ = drive(track_named("savoiardo"), Rules(laps=2), cap=1.5, seconds=40.0)
    assert follower.good
    assert len(follower.driven.lap_times) == 2
    assert follower.driven.lap_times[1] == pytest.approx(follower.expected, rel=0.03)


def test_a_lost_pose_stops_the_car():
    follower, rows = drive(each=make_tracking_hook(0.0, 1.5))
    assert not follower.good
    assert "the pose was lost: LOST" in follower.why
    stops = rows[np.argmax(rows[:, 0] > 1.5 + MAX_POSE_GAP + 0.02):, 5]
    assert (np.diff(stops) <= 0.0).all()
    assert rows[-1, 1] < 3.5


@pytest.mark.slow
def test_a_pose_that_is_lost_for_a_moment_does_not():
    """The control."""
    follower, _ = drive(each=lambda t, f, m: replace(
        m, tracking=Tracking.DEAD_RECKONING) if 1.5 < t < 1.5 + 0.8 * MAX_POSE_GAP else m)
    assert follower.good


def gap(seconds, std=0.0):
    """A hook: dead reckoning from 1.5 s on, one sigma [m] of the place."""
    def each(t, follower, motion):
        if not 1.5 < t < 1.5 + seconds:
            return motion
        return replace(motion, tracking=Tracking.DEAD_RECKONING, cov=std**2 * np.eye(5))
    return each


def follow_with_gap(seconds, std=0.0, silent=True):
    """The follower of a drive with such a gap."""
    follower = Follower(STRAIGHT, PLANT, 1.0, "lqr")
    follower.silent = lambda: silent
    light_drive(follower, UPSTREAM_2024, each=gap(seconds, std))
    assert follower.phase is Phase.ENDED
    return follower


@pytest.mark.slow
def test_a_silent_lidar_is_bridged_for_a_second_and_no_longer():
    assert follow_with_gap(0.9 * MAX_BRIDGED_GAP).good
    assert "the pose was lost" in follow_with_gap(1.1 * MAX_BRIDGED_GAP).why


def test_poses_that_are_rejected_are_not_bridged():
    """They are of another body or of a wrong match: the control of the gap."""
    def each(t, follower, motion):
        return replace(motion, tracking=Tracking.JUMPED) if t > 1.5 else motion

    follower = Follower(STRAIGHT, PLANT, 1.0, "lqr")
    follower.silent = lambda: True
    light_drive(follower, UPSTREAM_2024, each=each)
    assert "the pose was lost: JUMPED for 0.5 s" in follower.why


@pytest.mark.slow
def test_but_not_where_scans_fit_no_map_nor_where_the_place_is_not_known():
    """The controls."""
    assert "the pose was lost" in follow_with_gap(0.9 * MAX_BRIDGED_GAP, silent=False).why
    assert "the pose was lost" in follow_with_gap(0.9 * MAX_BRIDGED_GAP, std=0.11).why


def test_out_of_the_lane_it_stops():
    """It is measured 0.35 m from where it was."""
    def each(t, follower, motion):
        pose = motion.pose
        return replace(motion, pose=Pose(pose.x, pose.y + 0.35, pose.yaw)) if t > 2.0 else motion

    follower, rows = drive(each=each)
    assert "the car left the lane: 0.3" in follower.why
    assert rows[-1, 1] < 2.8


def test_out_of_time_it_stops():
    follower, rows = drive(rules=Rules(duration=2.0))
    assert follower.good
    assert "the time of 2 s is over" in follower.why
    assert rows[-1, 0] < 4.0


def test_stopped_by_a_word():
    def each(t, follower, motion):
        if t > 1.5:
            follower.stop("enough")
        return motion

    follower, rows = drive(each=each)
    assert (follower.why, follower.good) == ("enough", True)
    assert rows[-1, 1] < 2.5


@pytest.mark.slow
def test_the_speed_may_be_changed_on_the_way():
    def each(t, follower, motion):
        follower.cap = 0.5 if t > 2.0 else 1.0
        return motion

    _, rows = drive(each=each)
    assert rows[(rows[:, 0] > 2.6) & (rows[:, 1] < 3.5), 4].mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("cap", [float("nan"), -0.1, "1", None, True])
def test_what_is_no_speed_limit_is_refused_at_any_time(cap):
    follower = Follower(LONG, PLANT, 0.5)
    with pytest.raises(UsageError, match="cap is no speed limit"):
        follower.cap = cap
    assert follower.cap == 0.5
    with pytest.raises(UsageError, match="cap is no speed limit"):
        Follower(LONG, PLANT, cap)


def test_a_car_that_stands_still_for_a_doubted_speed_names_the_doubt():
    follower = Follower(LONG, PLANT, 1.0, rules=Rules(odometry=True))
    follower.doubts = "ENCODER_DEAD"
    t = 0.0
    while follower.phase is not Phase.ENDED and t < 20.0:
        follower.answer(motion_at(t, Pose(), 0.0, 0.0))
        t += 0.01
    assert "the car does not move" in follower.why
    assert "ENCODER_DEAD of its speed, so throttle is withheld" in follower.why


@pytest.mark.parametrize("rules", [{"lane": -1.0}, {"lane": float("nan")}, {"laps": 0},
                                   {"laps": -1}, {"duration": float("nan")}, {"duration": "3"}])
def test_rules_that_are_none_are_refused(rules):
    with pytest.raises(UsageError, match="of the rules is not above 0"):
        Rules(**rules)


@pytest.mark.slow
def test_a_cap_of_nothing_holds_the_car_and_is_no_end():
    """Longer than a car may rest when it is commanded to drive."""
    def each(t, follower, motion):
        follower.cap = 0.0 if 2.0 < t < 3.0 + STUCK_TIME + 2.0 else 1.0
        return motion

    follower, rows = drive(each=each)
    held = rows[(rows[:, 0] > 4.0) & (rows[:, 0] < 7.5)]
    assert np.ptp(held[:, 1]) < 0.02
    assert (held[:, 5] == 0.0).all()
    assert follower.good
    assert follower.why == "the path is driven"


def test_no_pose_no_drive():
    """Dead reckoning in a frame of its own is no place in the room."""
    follower = Follower(STRAIGHT, PLANT, 1.0)
    for t in np.arange(0.0, MAX_START_WAIT + 0.3, 0.1):
        command = follower.answer(motion_at(t, Pose(), 0.0, 0.0, Tracking.LOST, START_FRAME))
        assert command == (0.0, 0.0)
    assert follower.phase is Phase.ENDED
    assert "no pose came" in follower.why
    by_odometry = Follower(STRAIGHT, PLANT, 1.0, rules=Rules(odometry=True))
    assert by_odometry.answer(motion_at(0.0, Pose(), 0.0, 0.0, Tracking.LOST,
                                        START_FRAME)).speed > 0.0


@pytest.mark.slow
def test_a_car_that_never_comes_to_the_path_is_stopped():
    def each(t, follower, motion):
        pose = motion.pose
        return replace(motion, pose=Pose(pose.x, 0.6, 0.0))

    long = Path([(20.0, 0.0)], closed=False)
    follower, rows = drive(long, each=each)
    assert "did not come into the lane" in follower.why
    assert (
        MAX_JOIN_DISTANCE
        < np.hypot(*np.diff(rows[:, 1:3], axis=0).T).sum()
        < MAX_JOIN_DISTANCE + 1.0
    )


@pytest.mark.parametrize(("pose", "match"), [
    (Pose(1.0, 1.3, 0.0), r"1\.30 m away from the path"),
    (Pose(1.0, 0.2, 2.5), "points against the path"),
])
def test_a_start_that_is_none(pose, match):
    with pytest.raises(UsageError, match=match) as refused:
        find_start(STRAIGHT, pose)
    assert "--here" in refused.value.remedy


def test_a_start_is_found_anywhere_and_by_the_heading():
    """At its crossing the eight goes two ways; a start may be on any part of a lap."""
    eight = track_named("eight")
    half = eight.length / 2
    assert find_start(eight, Pose(0.02, 0.0, 0.1)) % half == pytest.approx(0.02, abs=0.03)
    spot = eight.interpolate(9.0)
    assert find_start(eight, Pose(spot.x, spot.y, spot.heading + 1.2)) == pytest.approx(
        9.0, abs=0.03
    )
    with pytest.raises(UsageError, match="against"):
        find_start(Path([(2 * pi, 1.0)], closed=True), Pose(0.0, 0.0, pi))


@pytest.mark.slow
def test_a_drive_may_begin_anywhere():
    track = track_named("savoiardo")
    spot = track.interpolate(5.0)
    follower, _ = drive(track, start=(spot.x + 0.4, spot.y + 0.6, spot.heading + 0.9), seconds=40.0)
    assert follower.good
    assert follower.begun_at == pytest.approx(5.0, abs=1.0)
    assert follower.driven.table[-1, 6] > follower.begun_at + track.length


@pytest.mark.slow
def test_here_lays_the_path_from_the_car():
    follower, rows = drive(rules=Rules(here=True), start=(3.0, 2.0, 1.0))
    assert follower.begun_at == pytest.approx(0.0, abs=1e-6)
    assert rows[-1, 1:3] == pytest.approx((3.0 + 4.0 * np.cos(1.0), 2.0 + 4.0 * np.sin(1.0)),
                                          abs=0.06)


def test_laps_of_an_open_path():
    with pytest.raises(UsageError, match="not closed") as refused:
        Follower(STRAIGHT, PLANT, 1.0, rules=Rules(laps=2))
    assert "4.00 m between its ends" in refused.value.found


def test_a_path_shorter_than_the_car_is_refused():
    with pytest.raises(UsageError, match="shorter than the car") as refused:
        Follower(Path([(0.03, 0.0)], closed=False), PLANT, 1.0)
    assert "not in m" in refused.value.likely


def observe_phases(start, path=LONG, cap=1.0):
    """The follower of a drive from ``start`` and its phase at each call."""
    phases = []

    def each(t, follower, motion):
        phases.append(follower.phase)
        return motion

    follower = Follower(path, PLANT, cap, "lqr")
    rows = light_drive(follower, UPSTREAM_2024, start=start, each=each, seconds=20.0)
    return follower, rows, phases


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [-1.5, -1.2, 1.2, 1.5])
def test_a_car_turned_on_the_path_joins_before_it_must_stay_in_the_lane(yaw):
    follower, rows, phases = observe_phases((0.0, 0.0, yaw))
    assert follower.why == "the path is driven"
    assert Phase.JOINING in phases
    largest = np.abs(rows[:, 3]).max()
    assert largest > 0.25, "control: the turn needs most of the lane, or more"
    following = np.array(phases) == Phase.FOLLOWING
    assert np.abs(rows[:len(following), 3][following]).max() < follower.rules.lane


@pytest.mark.slow
def test_a_car_along_the_path_follows_at_once():
    _, _, phases = observe_phases((0.0, 0.05, 0.1))
    assert Phase.JOINING not in phases[2:]


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "yaw"), [(0.9, 1.2), (-0.9, -1.2), (0.6, 1.57)])
def test_a_start_that_must_turn_too_far_from_the_path_is_refused(offset, yaw):
    with pytest.raises(UsageError, match=r"the first turn would lead the car 1[.]\d\d m away"):
        observe_phases((1.0, offset, yaw))
    follower, _, _ = observe_phases((1.0, offset, -yaw / 2.0))
    assert follower.good, "control: it points towards the path"


def test_a_drive_that_goes_away_before_the_lane_ends():
    """Its steering is held straight, away from the path."""
    follower = Follower(LONG, PLANT, 1.0, "lqr")
    moved = {}

    def each(t, follower, motion):
        moved[t] = 0.9 + 0.5 * max(t - 1.0, 0.0)
        return replace(motion, pose=Pose(motion.pose.x, moved[t], 0.0))

    light_drive(follower, UPSTREAM_2024, start=(0.0, 0.9, 0.0), each=each)
    assert "the car went away from the path before it was in the lane: 1.3" in follower.why


def test_a_missing_pose_states_its_reason():
    follower = Follower(STRAIGHT, PLANT, 1.0, "lqr")
    follower.missing_reason = lambda: "the lidar is silent"
    for t in (0.0, 1.1 * MAX_START_WAIT):
        follower.answer(motion_at(t, Pose(), 0.0, 0.0, Tracking.LOST, START_FRAME))
    assert follower.why == "no pose came within 5 s: the lidar is silent"


def test_an_unknown_tracker_is_refused():
    with pytest.raises(UsageError, match="no such tracker") as refused:
        Follower(LONG, PLANT, 1.0, tracker="foo")
    assert "lqr" in refused.value.expected


@pytest.mark.slow
@pytest.mark.parametrize(("std", "ends"), [(0.15, False), (0.25, True)])
def test_an_uncertain_position_ends_the_drive(std, ends):
    """Two thirds of the lane of 0.3 m."""
    def blur(now, follower, motion):
        cov = motion.cov.copy()
        cov[0, 0] = cov[1, 1] = std**2 if now > 1.5 else 1e-4
        return replace(motion, cov=cov)

    follower, _ = drive(LONG, each=blur)
    assert follower.good is not ends
    assert ("the position is uncertain" in follower.why) is ends


@pytest.mark.parametrize(("cap", "commanded"), [(0.1, 0.0), (0.2, 0.2)])
def test_a_cap_that_no_motor_can_hold_makes_the_car_wait(cap, commanded):
    follower = Follower(LONG, PLANT, cap)
    for k in range(50):
        command = follower.answer(motion_at(0.01 * k, Pose(1.0, 0.0, 0.0), 0.0, 0.0))
    assert command.speed == pytest.approx(commanded)


def test_a_car_at_the_end_of_an_open_path_is_refused():
    follower = Follower(LONG, PLANT)
    with pytest.raises(UsageError, match="at the end of the path") as caught:
        follower.answer(motion_at(0.0, Pose(8.9, 0.0, 0.0), 0.0, 0.0))
    assert "--here" in caught.value.remedy
