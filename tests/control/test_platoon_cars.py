"""A platoon of emulated cars: who touches whom, who lies, who is silent, and what the ESC gets."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dart_hal.car import Fleet
from dart_hal.control.paths import Path
from dart_hal.control.platoon.car import PlatoonCar
from dart_hal.control.platoon.spacing import FRONT_LENGTH, REAR_LENGTH, gap_from_pose, measure_gap
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose
from dart_hal.vehicle.sets import UPSTREAM_2024
from studies.control import platoon_cars as cars
from studies.control.light_follow import motion_at, plant_by
from studies.control.platoon_cars import example, gaps, lateral
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

SHORT = {"cars": 3, "lasts": 8.0, "brakes": 5.5, "loss": 0.3}
BRIEF = {**SHORT, "cars": 2, "lasts": 5.5, "brakes": 5.0}


def tail(path, s, width=0.19, n=12):
    """Points of the tail of a car whose rear axle is at s [m]."""
    spot = path.interpolate(s - REAR_LENGTH)
    aside = np.linspace(-0.5, 0.5, n)[:, None] * width
    return np.array((spot.x, spot.y)) + aside * (-np.sin(spot.heading), np.cos(spot.heading))


@pytest.mark.parametrize(("path", "s", "most"), [
    (Path([(20.0, 0.0)], closed=False), 4.0, 0.002),
    (track_named("racetrack_vicon_2"), 2.2, 0.03)], ids=["straight", "bend"])
def test_the_gap_by_a_scan_is_to_what_is_in_the_lane(path, s, most):
    away = s + 0.6 + FRONT_LENGTH + REAR_LENGTH
    board = np.array([(p.x - 0.35 * np.sin(p.heading), p.y + 0.35 * np.cos(p.heading))
                      for p in map(path.interpolate, np.arange(s, s + 3.0, 0.05))])
    points = np.vstack((tail(path, away), board, [[0.0, 0.0]]))
    t = np.linspace(1.0, 1.1, len(points))
    gap = measure_gap(points, t, path, np.full(len(points), s))
    assert gap.metres == pytest.approx(0.6, abs=most)
    assert gap.t == pytest.approx(t[:12].mean())
    assert measure_gap(board, t[12:-1], path, np.full(len(board), s)) is None, (
        "control: boards alone"
    )
    spot = path.interpolate(away)
    assert gap_from_pose(spot.x, spot.y, 1.0, path, s).metres == pytest.approx(0.6, abs=0.01)


def test_two_stray_points_are_no_car():
    path = Path([(20.0, 0.0)], closed=False)
    points = np.vstack(([[4.4, 0.0], [4.42, 0.05]], tail(path, 5.0)))
    gap = measure_gap(points, np.ones(len(points)), path, np.full(len(points), 4.0))
    assert gap.metres == pytest.approx(5.0 - REAR_LENGTH - 4.0 - FRONT_LENGTH, abs=0.002)


@pytest.mark.slow
def test_a_fleet_takes_the_lidar_of_each_car_as_its_source_of_poses(tmp_path):
    chart = example.corridor(tmp_path, 8.0)
    with Fleet.open(example.urls_of(chart, ["3,0,0"], [0]), poses=[f"lidar:{chart}?start=3,0,0"]
                    ) as fleet:
        *_, (last,) = fleet.states(duration=0.6)
    assert last.external.estimate.pose.x == pytest.approx(3.0, abs=0.03)
    with pytest.raises(UsageError, match="not a source"):
        Fleet.open(["sim://?nano=mock"], poses=["lidars:map.yaml"])


def driving(truth, n, since, until=np.inf):
    """Pulses [us] at the ESC of car n from ``since`` to ``until`` [s] that drive forward."""
    return [us for t,
            us in truth.pulses[n] if since < t < until and us > NEUTRAL_US + NEUTRAL_TOLERANCE_US]


@pytest.mark.slow
def test_a_liar_ends_in_no_contact_and_as_published_in_one():
    lies = {1: lambda t: 1000.0 if t > 2.0 else None}
    drive, truth = cars.straight(1, lies=lies, **SHORT)
    assert not drive.contacts
    assert gaps(truth).min() > 0.1
    assert [n for n in (1, 2) if drive.cars[n].follower.detector.attacked] == [2]
    assert "ACC" in drive.of(2)[8][-50:]
    bare, true = cars.straight(1, lies=lies, make=example.published, gains=example.DART,
                               **{**SHORT, "lasts": 9.0, "brakes": 7.0})
    assert bare.contacts, "control"
    assert gaps(true).min() < 0.0
    assert driving(true, 2, 6.0), "it drives on, 8 cm behind the car ahead"


def replace_answer(monkeypatch, number, since, act):
    """Let car ``number`` do otherwise from ``since`` s of its drive on: act(answer, motion, scans,
    ahead), with the answer of every other car. The cars as they are made."""
    made = []
    begun = []

    class Otherwise(PlatoonCar):
        def answer(self, motion, scans=(), predecessor=None):
            if self is not made[number]:
                return super().answer(motion, scans, predecessor)
            begun.append(motion.t)
            if motion.t - begun[0] < since:
                return super().answer(motion, scans, predecessor)
            return act(super().answer, motion, scans, predecessor)

    def make(*given, **how):
        made.append(Otherwise(*given, **how))
        return made[-1]

    monkeypatch.setattr(example, "PlatoonCar", make)
    return made


@pytest.mark.long
def test_behind_a_silent_car_it_follows_by_its_lidar():
    drive, truth = cars.straight(4, silent=(1,), **SHORT)
    assert not drive.contacts
    assert gaps(truth).min() > 0.1
    follower = drive.cars[2].follower
    assert set(follower.counts) <= {"ACC", "STOP", "RULE"}
    assert follower.counts["ACC"] > 100
    assert not follower.hearing.counts
    assert truth.speed[500][2] > 0.7, "and it does follow"
    assert drive.cars[1].follower.counts["CACC"] > 100, "control"


@pytest.mark.slow
def test_a_leader_whose_esc_is_neutral_at_once_is_not_touched(monkeypatch):
    """It slows down harder than the platoon brakes, and reports another acceleration."""
    replace_answer(
        monkeypatch, 0, 4.0, lambda answer, *measure_gap: answer(*measure_gap)._replace(speed=0.0)
    )
    drive, truth = cars.straight(5, **{**SHORT, "brakes": 99.0})
    speed = np.array(truth.speed)[:, 0]
    assert speed[380] > 0.9
    assert speed[380] - speed[460] > 0.5, "control: in 0.6 s"
    assert not driving(truth, 0, 4.2)
    assert not drive.contacts
    assert gaps(truth).min() > 0.1


@pytest.mark.slow
def test_a_car_that_sees_nothing_brakes_to_rest_and_so_does_who_follows(monkeypatch):
    made = replace_answer(monkeypatch, 1, 4.0, lambda answer, motion, *measure_gap: answer(motion))
    drive, truth = cars.straight(3, **{**SHORT, "brakes": 99.0})
    assert made[1].mode == "STOP"
    assert made[1].why == "no gap is known for 0.5 s"
    assert truth.speed[380][1] > 0.8, "control: it drove until then"
    assert np.abs(np.array(truth.speed)[-100:, 1:]).max() < 0.05
    held = np.median(driving(truth, 1, 2.0, 4.0))
    assert np.median(driving(truth, 1, 4.7, 5.7)) < held - 20.0, "on the way to rest: it rolls"
    assert not driving(truth, 1, 6.2)
    assert driving(truth, 0, 6.2), "control: the leader drives on"
    assert not drive.contacts


@pytest.mark.long
def test_between_boards_no_pose_that_is_off_across_is_followed():
    """A lidar that sees its lane steers better than a pose that is up to 4 cm off, and the doors
    in the boards are no lane."""
    drive, truth = cars.straight(1, bias=0.04, tracker="lane", hall=cars.lane, **BRIEF)
    assert not drive.contacts
    assert gaps(truth).min() > 0.1
    assert np.array(truth.speed)[450].min() > 0.7, "and it does drive"
    assert lateral(truth) < 0.01
    _, posed = cars.straight(1, bias=0.04, hall=cars.lane, **BRIEF)
    assert lateral(posed) > 0.015, "control"


@pytest.mark.slow
def test_where_the_boards_end_it_stops():
    """The lane ends 3 m ahead, and no pose or gap is lost."""
    def short(folder):
        return cars.lane(folder, until=8.0)

    on_and_on = {**BRIEF, "lasts": 7.0, "brakes": 99.0}
    drive, truth = cars.straight(1, tracker="lane", hall=short, **on_and_on)
    leader = drive.cars[0]
    assert leader.mode == "STOP"
    assert re.fullmatch("(no boards are|only the (left|right) board is) visible for 0.5 s",
                        leader.why)
    assert driving(truth, 0, 3.0, 4.0), "control: it drove until then"
    assert not driving(truth, 0, 6.5)
    assert not drive.contacts
    _, on = cars.straight(1, hall=short, **on_and_on)
    assert driving(on, 0, 6.5), "control: by its pose it drives on"


@pytest.mark.long
@pytest.mark.parametrize("seed", range(101, 107))
def test_random_drives_of_five_cars_with_half_of_the_messages_lost(seed):
    drive, truth = cars.straight(seed, bias=0.02, **cars.scenario(seed))
    assert not drive.contacts
    assert gaps(truth).min() > 0.02
    assert lateral(truth) < 0.035, "the median of seeds is below 3 cm"


@pytest.mark.long
def test_on_the_track_between_its_boards():
    drive, truth = cars.on_track(4, lasts=20.0, brakes=17.0)
    assert not drive.contacts
    for n in range(5):
        assert np.abs(drive.of(n)[7][300:]).max() < 0.10
    assert np.array(truth.speed)[1500].min() > 0.8


def drive_straight(path, seconds, y=0.0):
    """A car without inertia on the x axis; returns it and its last command."""
    car = PlatoonCar(path, plant_by(UPSTREAM_2024), drives=lambda t, speed: 1.0 - speed)
    x = v = 0.0
    for k in range(round(100 * seconds)):
        command = car.answer(motion_at(0.01 * k, Pose(x, y(x) if callable(y) else y, 0.0), v, 0.0))
        v = command.speed
        x += 0.01 * v
    return car, x, v


def test_a_platoon_car_stops_at_the_end_of_its_path_and_outside_its_lane():
    path = Path([(5.0, 0.0)], closed=False)
    car, x, v = drive_straight(path, 12.0)
    assert (v, car.why) == (0.0, "the path ends")
    assert x == pytest.approx(4.9, abs=0.15)
    long = Path([(30.0, 0.0)], closed=False)
    car, _, v = drive_straight(long, 8.0, y=lambda x: 0.1 * max(x - 1.0, 0.0))
    assert v == 0.0
    assert "from the path" in car.why
    car, _, v = drive_straight(long, 8.0)
    assert v > 0.5, "control"
    assert car.why == ""


def test_a_pause_of_the_program_repeats_no_steps():
    """Each step of the law integrates its full period."""
    car = PlatoonCar(Path([(30.0, 0.0)], closed=False), plant_by(UPSTREAM_2024))
    steps = []
    choose = car._choose_acceleration
    car._choose_acceleration = lambda t, *rest: (steps.append(t), choose(t, *rest))[1]
    for t in (*np.arange(0.0, 1.0, 0.01), *np.arange(3.0, 4.0, 0.01)):
        car.answer(motion_at(float(t), Pose(0.1 * t, 0.0, 0.0), 0.1, 0.0))
    assert sum(t >= 3.0 for t in steps) == pytest.approx(20, abs=2)
