"""Plans: pure data, rehearsed on the floor that was stated."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from dart_hal.core.errors import ExperimentFailed, UsageError
from dart_hal.core.types import Pose
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.experiment.excitation import Chirp, Levels, Ramp, random_steps
from dart_lab.identification.experiment.floor import Floor, make_fence
from dart_lab.identification.experiment.limits import RollingDistance, stays_inside
from dart_lab.identification.experiment.make import make_plan
from dart_lab.identification.experiment.plans import EXPERIMENTS, PROBES
from dart_lab.identification.experiment.rehearsal import PaperCar, rehearse_plan
from dart_lab.identification.experiment.runner import run_plan
from dart_lab.identification.experiment.track import DriveTrack


@pytest.mark.parametrize(("text", "sides"), [("8", (8.0, 8.0)), ("12x3", (12.0, 3.0)),
                                             ("12.5 m x 3 m", (12.5, 3.0))])
def test_floor_is_read(text, sides):
    floor = Floor.parse(text.replace(" ", ""))
    assert (floor.length, floor.width) == sides


@pytest.mark.parametrize("text", ["", "x", "8x", "8x3x2", "nan", "inf", "-4", "0.1", "1e9"])
def test_floor_that_is_none_is_refused(text):
    with pytest.raises(UsageError, match="not a floor"):
        Floor.parse(text)


@pytest.mark.parametrize(("name", "floor"), [
    ("friction", "8x2.5"), ("friction", "40x1"), ("motor", "7x3"), ("delay", "6x5.5"),
    ("tyres", "4.5")])
@pytest.mark.slow
def test_rehearsed_drive_stays_on_the_floor_and_below_its_speed(name, floor, files):
    plan = make_plan(name, files, Floor.parse(floor), None)
    drive = run_plan(PaperCar(files), plan)
    assert not drive.stopped
    assert all(plan.fence.inside(f.pose.x, f.pose.y) for f in drive.frames)
    assert max(f.speed for f in drive.frames) <= plan.speed + 0.15
    assert any(f.measured for f in drive.frames)
    assert plan.seconds == pytest.approx(drive.frames[-1].t)
    assert drive.frames[-1].speed < 0.05


@pytest.mark.parametrize(("name", "floor"), [
    ("standstill", "2"), ("crawl", "5"), ("circles", "6"), ("steps", "6x5.5"),
    ("staircase", "6"), ("weave", "6"), ("rollouts", "6"), ("launch", "7x4"), ("laps", "6x4")])
@pytest.mark.slow
def test_probe_stays_on_the_floor_and_is_not_stopped(name, floor, files):
    plan = make_plan(name, files, Floor.parse(floor), None)
    drive = run_plan(PaperCar(files), plan)
    assert not drive.stopped  # at the fence, or well above its speed
    assert all(plan.fence.inside(f.pose.x, f.pose.y) for f in drive.frames)
    assert any(f.measured for f in drive.frames)
    assert drive.frames[-1].speed < 0.05


@pytest.mark.slow
def test_a_corridor_is_driven_straight_and_a_hall_as_an_oval(files):
    assert not make_plan("friction", files, Floor(40.0, 1.0), None).oval
    plan = make_plan("friction", files, Floor(8.0, 3.0), None)
    assert plan.oval
    _, drive = rehearse_plan(plan, files)
    turned = {round(math.remainder(f.pose.yaw, 2.0 * math.pi), 0) for f in drive.frames
              if f.measured}
    assert turned <= {0.0, -3.0, 3.0}  # pulls go there and back, none of them in a turn


@pytest.mark.parametrize("name", [*EXPERIMENTS, *(n for n in PROBES if n != "standstill")])
@pytest.mark.slow_except("friction")
def test_too_small_a_floor_names_what_is_needed(name, files):
    with pytest.raises(ExperimentFailed) as error:
        make_plan(name, files, Floor(2.0, 2.0), None)
    assert "2 m x 2 m" in error.value.what
    assert " m" in error.value.expected
    assert "floor" in error.value.remedy


@pytest.mark.parametrize("name", ["friction", "motor"])
@pytest.mark.slow
def test_speed_too_high_for_the_floor_names_one_that_fits(name, files):
    floor = Floor(8.0, 3.0)
    with pytest.raises(ExperimentFailed) as error:
        make_plan(name, files, floor, 4.0)
    assert "4.0 m/s" in error.value.what
    fits = float(error.value.remedy.split()[1])
    plan = make_plan(name, files, floor, fits)
    assert plan.speed == fits
    with pytest.raises(ExperimentFailed):
        make_plan(name, files, floor, fits + 0.2)


def test_unknown_experiment_lists_those_that_exist(files):
    with pytest.raises(UsageError, match="no experiment"):
        make_plan("battery", files, Floor(9.0, 9.0), None)


def test_rolling_distance_is_that_of_the_friction_with_a_reserve():
    rolling, speeds = RollingDistance(PAPER), np.array([0.5, 1.0, 2.0, 3.0])
    slowing = (PAPER.friction.a + 0.5 * PAPER.friction.c * speeds) / PAPER.body.mass
    free = speeds**2 / (2.0 * slowing)
    ahead = np.array([rolling(float(v)) for v in speeds])
    assert np.all(ahead > free)
    assert np.all(ahead < 1.6 * free + 0.15 * speeds)
    assert rolling(0.0) == pytest.approx(0.0, abs=1e-3)


def test_fence_looks_ahead_along_the_arc():
    from dart_lab.identification.experiment.floor import StartPlace
    fence = make_fence(Floor(6.0, 6.0), StartPlace(3.0, 3.0), margin=0.0)
    at = Pose(2.5, 0.0, 0.0)
    assert not stays_inside(fence, at, 0.0, 1.0)  # straight through the wall
    assert stays_inside(fence, at, 1.0 / 0.4, 1.0)  # turns away before it
    assert not stays_inside(fence, Pose(3.1, 0.0, math.pi), 0.0, 0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_lane_keeping_steers_back_to_the_lane(side):
    track = DriveTrack(5.0, oval=True)
    assert side * track.along_lane(Pose(1.0, 0.2 * side, 0.0), 1.0, 0.175) < 0.0
    assert side * track.along_lane(Pose(1.0, 0.0, 0.2 * side), 1.0, 0.175) < 0.0
    back = Pose(3.0, 1.5 - 0.2 * side, math.pi)
    assert side * track.along_lane(back, 1.0, 0.175) < 0.0


@pytest.mark.parametrize("oval", [True, False])
def test_a_car_set_down_before_the_lane_has_all_of_it_ahead(oval):
    track = DriveTrack(5.0, oval=oval)
    track.update(Pose(-0.002, 0.0, 0.0))
    assert track.remaining == pytest.approx(5.0, abs=0.01)
    track.update(Pose(0.1, 0.0, 0.0))
    assert track.remaining == pytest.approx(4.9, abs=0.01)


def test_signals():
    chirp = Chirp(0.5, 0.4, 0.25, 2.5, 12.0)
    t = np.arange(0.0, 12.0, 0.001)
    values = np.array([chirp(float(x)) for x in t])
    assert values.min() >= 0.1 - 1e-9
    assert values.max() <= 0.9 + 1e-9
    crossings = t[1:][np.diff(np.sign(values - 0.5)) > 0]
    assert 1.0 / np.diff(crossings)[0] == pytest.approx(0.31, abs=0.05)
    assert 1.0 / np.diff(crossings)[-1] == pytest.approx(2.4, abs=0.15)
    ramp = Ramp(0.1, 0.3, 10.0)
    assert [ramp(-1.0), ramp(5.0), ramp(99.0)] == pytest.approx([0.1, 0.2, 0.3])
    steps = random_steps(-1.0, 1.0, 10, 0.5)
    assert isinstance(steps, Levels)
    assert np.all(np.diff(np.sign(steps.levels)) != 0)
    assert steps == random_steps(-1.0, 1.0, 10, 0.5)
    assert steps(99.0) == steps.levels[-1]


@pytest.mark.slow
def test_the_floor_that_the_steering_test_requests_is_enough(files):
    with pytest.raises(ExperimentFailed) as raised:
        make_plan("steering", files, Floor(3.0, 3.0), None)
    remedy = re.search(r"--space ([0-9.]+)", raised.value.remedy)
    side = float(remedy.group(1))
    assert make_plan("steering", files, Floor(side, side), None).sweep.radius <= 0.5 * side
    with pytest.raises(ExperimentFailed):  # and not much more than that
        make_plan("steering", files, Floor(side - 0.2, side - 0.2), None)
