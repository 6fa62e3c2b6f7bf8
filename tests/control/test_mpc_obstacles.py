"""Discs near a path: where they lie, whether there is a way past, how near the body comes."""

from __future__ import annotations

from math import inf, pi

import numpy as np
import pytest

from dart_hal.control.follow import Follower, Phase
from dart_hal.control.mpc import generated, spread, tracker
from dart_hal.control.mpc.obstacles import Disc, Obstacle, clearance, required_offset
from dart_hal.control.paths import Path, figure_of_eight
from dart_hal.control.trackers import contouring
from dart_hal.core.errors import UsageError
from studies.control.light_follow import LATER, light_drive, plant_by
from studies.control.mpc_loop import Loop, P, controller
from studies.control.mpc_spread import COV, errors
from studies.control.obstacle_figures import passed
from tests.control.test_mpc import TRACK

OBSTACLE_PATH = Path([(9.0, 0.0)], closed=False)


def follower(disc: Disc, speed: float = 1.5, **options) -> Follower:
    return Follower(OBSTACLE_PATH, plant_by(LATER), speed, lambda path, plant: contouring(
        path, plant, discs=(disc,), **options))


@pytest.mark.parametrize(("x", "y", "offset"), [(4.65, 2.0, -0.15), (2.25, 0.2, 0.2)])
def test_a_disc_lies_across_from_the_nearest_point(x, y, offset):
    """The track begins at (2.25, 0) along +x; x = 4.5 is a straight upwards."""
    (o,) = Disc(x, y, 0.1, 0.3).locate(TRACK, 7.0)
    spot = TRACK.interpolate(o.s)
    assert o.offset == pytest.approx(offset, abs=1e-3)
    assert spot.x - o.offset * np.sin(spot.heading) == pytest.approx(x, abs=1e-3)
    assert spot.y + o.offset * np.cos(spot.heading) == pytest.approx(y, abs=1e-3)
    assert (o.speed, o.t, o.radius) == (0.3, 7.0, 0.1)


def test_one_behind_the_end_is_not_at_the_end():
    (o,) = Disc(12.0, 0.1, 0.1).locate(OBSTACLE_PATH, 0.0)
    assert (o.s, o.offset) == pytest.approx((12.0, 0.1))


@pytest.mark.parametrize(("x", "y", "yaw", "expected"), [
    (0.0, 0.0, 0.0, 0.65), (0.0, 0.4, 0.0, 0.70139), (1.0, 0.3, 0.0, 0.0), (1.0, 0.35, pi / 2, 0.0),
    (1.0, 0.0, 0.0, -0.3)])
def test_air_between_a_body_and_a_disc(x, y, yaw, expected):
    """A body of 0.3 x 0.2 m, a disc of 0.2 m which has come to x = 1 in 2 s."""
    o = Obstacle(0.0, 0.0, 0.2, 0.5, 1.0)
    assert clearance(x, y, yaw, o, OBSTACLE_PATH, 3.0) == pytest.approx(expected, abs=1e-5)


def test_one_in_the_middle_is_refused_by_its_place():
    with pytest.raises(UsageError, match="obstacle 1 leaves no passage within the lane") as caught:
        light_drive(follower(Disc(6.0, 0.02, 0.15)))
    assert "an offset of 0.35 m" in str(caught.value)
    assert "--lane 0.39" in str(caught.value)


def test_with_the_lane_that_it_requests_there_is_a_passage():
    disc = Disc(6.0, 0.02, 0.15)
    begun = follower(
        disc,
        lane=required_offset(*disc.locate(OBSTACLE_PATH, 0.0)) + tracker.OBSTACLE_LANE_MARGIN
        + 0.005,
    )
    begun.tracker.begin(0.0)


@pytest.mark.slow
def test_it_reports_how_near_it_came():
    """By the true rows: 12 cm are aimed at."""
    disc = Disc(6.0, -0.15, 0.15)
    drive = follower(disc)
    rows = light_drive(drive)
    (o,) = disc.locate(OBSTACLE_PATH, 0.0)
    ahead = LATER.body.l_r
    level = min(clearance(x + ahead, y, 0.0, o, OBSTACLE_PATH, t) for t, x, y, *_ in rows)
    assert drive.why == "the path is driven"
    assert 0.05 < drive.tracker.air[0] < 0.14
    assert drive.tracker.air[0] == pytest.approx(level, abs=0.03)


@pytest.mark.slow
def test_an_emulated_car_passes_one_with_5_cm_of_air():
    """On the path itself the body would be 10 cm inside it."""
    assert passed(1, 2.0, 0.5)[0] >= 0.05


def test_without_casadi_it_drives_on_numpy_and_reports_it(monkeypatch):
    def none(*_):
        raise UsageError("contouring control in C needs casadi")

    monkeypatch.setattr(generated, "compile_lineariser", none)
    begun = follower(Disc(30.0, 0.0, 0.1), compiled=True)
    assert "needs casadi" in begun.tracker.compile_error
    assert follower(Disc(30.0, 0.0, 0.1)).tracker.compile_error == ""


def test_a_plan_states_its_lateral_deviation():
    """It begins at what is known and grows."""
    loop = Loop(controller(P, TRACK, 1.5))
    for _ in range(4):
        plan = loop.step()
    std = spread.lateral_std(plan, COV)
    assert std.shape == (21,)
    assert std[0] == pytest.approx(0.01, abs=1e-4)
    assert (np.diff(std) > 0.0).all()
    assert 0.02 < std[10] < 0.08


@pytest.mark.slow
def test_its_stated_deviation_is_honest(monkeypatch):
    """Two cars whose model is 5 % off, 1 s ahead; the control: a stage that adds nothing."""
    found, stated = (np.vstack(each) for each in zip(*(errors(k, 2.0) for k in (3, 5)),
                                                     strict=True))
    assert (np.abs(found[:, 10]) < 2.0 * stated[:, 10]).mean() > 0.8
    monkeypatch.setattr(spread, "HEADING_STD_PER_SPEED", 0.0)
    found, stated = errors(3, 2.0)
    assert (np.abs(found[:, 10]) < 2.0 * stated[:, 10]).mean() < 0.7


@pytest.mark.slow
def test_a_drive_goes_on_behind_a_disc_that_is_far_away():
    drive = follower(Disc(4.0, 2.0, 0.15))
    rows = light_drive(drive, seconds=2.0)
    assert drive.phase is not Phase.ENDED
    assert np.abs(rows[:, 3]).max() < 0.01
    assert 1.0 < drive.tracker.air[0] < inf


def measure_least_air(speed: float, shut_at: float) -> float:
    """Clearance [m] to a disc that is passed, where one more shuts the lane 2.6 m ahead from an arc
    length on."""
    passed_disc = Disc(4.0, -0.15, 0.15)
    drive = follower(passed_disc, speed)

    def shut(_t, drive, motion):
        if drive.tracker.s > shut_at:
            drive.tracker.set_moving_obstacles((Obstacle(shut_at + 2.6, 0.0, 0.15),))
        return motion

    light_drive(drive, each=shut)
    assert drive.why == "obstacles leave no way within the lane"
    assert drive.phase is Phase.ENDED
    return drive.tracker.air[0]


@pytest.mark.parametrize(("speed", "shut_at"), [(1.5, 3.1), (2.0, 2.9), (2.0, 3.3), (1.0, 3.5)])
@pytest.mark.slow
def test_lane_that_is_shut_while_an_obstacle_is_passed_leads_to_no_contact(speed, shut_at):
    assert measure_least_air(speed, shut_at) > 0.10


@pytest.mark.slow
def test_steering_back_to_the_path_would_hit_the_obstacle(monkeypatch):
    """The control."""
    monkeypatch.setattr(tracker.Contouring, "_find_course", lambda self, plan: tracker._ON_PATH)
    assert measure_least_air(2.0, 2.9) < 0.0


def test_an_obstacle_at_a_crossing_is_on_both_branches():
    eight = figure_of_eight(1.2)
    centre = np.array((eight.x.mean(), eight.y.mean()))
    found = Disc(*centre, 0.05).locate(eight, 0.0, reach=0.4)
    assert len(found) == 2
    assert abs(found[0].s - found[1].s) == pytest.approx(0.5 * eight.length, rel=0.1)
    assert len(Disc(*centre, 0.05, speed=0.3).locate(eight, 0.0, reach=0.4)) == 1, "it moves"
    k = len(eight.x) // 4
    assert len(Disc(float(eight.x[k]), float(eight.y[k]), 0.05).locate(eight, 0.0, 0.3)) == 1
