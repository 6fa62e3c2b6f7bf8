"""Steady cornering, speed profiles and racelines: laws, and figures by hand."""

from __future__ import annotations

from dataclasses import replace
from math import atan, pi, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from dart_hal.control import raceline as lines
from dart_hal.control.lap import BEND_SPEED_SHARE, MAX_LONGITUDINAL, SpeedProfile, speed_profile
from dart_hal.control.paths import Path
from dart_hal.control.raceline import minimum_time_line, raceline
from dart_hal.control.steady import CURVATURES, SPEEDS, Steady
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.vehicle.bicycle import make_acceleration
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.sets import PAPER
from studies.control.light_follow import LATER, plant_by
from studies.control.line_figures import drive_laps

PLANT = plant_by(LATER)


@pytest.mark.parametrize("p", [PAPER, LATER], ids=lambda p: p.name)
@pytest.mark.parametrize(("v", "node"), [(0.5, 17), (1.0, -17), (1.5, 12)])
def test_a_steady_bend_is_one_of_the_equations_of_motion(p, v, node):
    """Driven with the table's angle and the throttle that holds v, nothing changes."""
    k = float(np.sign(node) * CURVATURES[abs(node)])
    angle, slip = Steady(p).turn(k, v)
    vy = p.body.l_r * k * v + v * np.tan(slip)
    rates = make_acceleration(p)
    held = brentq(lambda tau: rates(v, vy, k * v, tau, angle)[0], 0.1, 0.6)
    assert rates(v, vy, k * v, held, angle) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert abs(rates(v, vy, k * v, held, 1.02 * angle)[2]) > 0.3  # the control


def test_slowly_and_without_slip_the_angle_is_ackermanns():
    steady = Steady(replace(PAPER, kind="kinematic"))
    assert steady.turn(1.2, 2.0) == pytest.approx((atan(1.2 * PAPER.body.wheelbase), 0.0), abs=1e-3)
    assert steady.max_speed(np.array([1.2, 2.5]), (-0.3, 0.3)) == pytest.approx((SPEEDS[-1], 0.0))


@pytest.mark.slow_except("paper")
@pytest.mark.parametrize("p", [PAPER, LATER, apply(LATER, "steering_trim", k=0.03)],
                         ids=["paper", "later", "trim"])
def test_the_table_is_monotone_and_turns_round(p):
    steady = Steady(p)
    assert (np.diff(steady.angle, axis=1) > 0.0).all()
    for v in (0.4, 1.1, 1.9):
        for k in (-1.3, -0.2, 0.0, 0.9):
            assert steady.curvature(steady.turn(k, v).angle, v) == pytest.approx(k, abs=2e-2)


def test_what_the_front_tyres_end_at_bounds_the_bend():
    """The paper's take 2.62 N of m v^2 k l_r / l, to the grid's next curvature."""
    right, left = Steady(PAPER).curvature_limits((-1.0, 1.0))
    after = np.append(CURVATURES, np.inf)[np.searchsorted(CURVATURES, left - 1e-9) + 1]
    per = PAPER.body.mass * SPEEDS**2 * PAPER.body.l_r / PAPER.body.wheelbase
    fast = (SPEEDS > 1.4) & (SPEEDS < 2.6)
    assert (per * left)[fast].max() < 1.1 * 2.62
    assert (per * after)[fast].min() > 0.85 * 2.62  # turned by 0.7 rad, it also brakes
    assert right == pytest.approx(-left)


def test_forces_across_and_along_stay_within_the_circle():
    path = track_named("racetrack_vicon_2")
    profile = speed_profile(path, PLANT, 5.0)
    v = profile.speed
    most = BEND_SPEED_SHARE * PLANT.steady.max_speed(path.curvature, PLANT.lock)
    along = np.diff(np.append(v, v[:1]) ** 2) / (2.0 * path.spacing)
    assert (v <= most + 1e-9).all()
    assert np.abs(along).max() <= MAX_LONGITUDINAL + 1e-9
    assert along.max() > 0.5 * MAX_LONGITUDINAL
    assert along.min() < -0.5 * MAX_LONGITUDINAL
    force = make_motor(LATER.motor, np)(1.0, v) + make_friction(LATER.friction, np)(v)
    assert (along <= force / LATER.body.mass + 1e-9).all()


def test_a_weak_motor_takes_longer():
    path = track_named("racetrack_vicon_2")
    weak = replace(PLANT, max_throttle=0.3)
    assert speed_profile(path, weak, 5.0).time > 1.05 * speed_profile(path, PLANT, 5.0).time


def test_a_straight_from_rest_to_rest():
    """At 2.8 m/s2 there and back: 2 sqrt(d / a)."""
    path = Path([(2.0, 0.0)], closed=False)
    profile = speed_profile(path, PLANT, 5.0)
    assert profile.speed[0] == 0.0
    assert profile.speed[-1] < 0.4
    assert profile.time == pytest.approx(2.0 * sqrt(2.0 / MAX_LONGITUDINAL), rel=0.05)
    assert profile.speed_at(-1.0) == 0.0


def test_the_cap_and_the_speeds_of_the_path_are_kept():
    ring = Path([(2 * pi * 2.0, 0.5)], closed=True)
    assert speed_profile(ring, PLANT, 0.8).time == pytest.approx(ring.length / 0.8)
    assert speed_profile(ring, PLANT, 5.0).limit_to(0.8).time == pytest.approx(ring.length / 0.8)
    ring.speed = np.full(len(ring.x), 0.5)
    assert speed_profile(ring, PLANT, 0.8).speed.max() == 0.5


def test_a_profile_is_periodic():
    ring = Path([(2 * pi * 2.0, 0.5)], closed=True)
    profile = SpeedProfile(ring, 1.0 + 0.1 * np.sin(ring.s / 2.0))
    assert profile.speed_at(3.0 + ring.length) == pytest.approx(profile.speed_at(3.0))
    assert profile.speed_at(3.0) == pytest.approx(1.0 + 0.1 * np.sin(1.5), abs=1e-4)


def test_a_path_that_is_too_tight_names_the_place():
    path = Path([(1.0, 0.0), (0.3 * pi, 1 / 0.3), (1.0, 0.0)], closed=False)
    with pytest.raises(UsageError, match=r"tighter than the car turns: at 1\.0") as refused:
        speed_profile(path, PLANT, 1.0)
    assert "0.300 m to the left" in refused.value.found
    assert "0.523 m to the left" in refused.value.expected
    with pytest.raises(UsageError, match="tighter"):
        speed_profile(track_named("racetrack_vicon"), PLANT, 1.0)


@pytest.mark.slow
def test_a_raceline_stays_in_the_lane_and_is_quicker():
    path = track_named("savoiardo")
    line = raceline(path, 0.2, PLANT, 5.0)
    s = 0.0
    left = []
    for x, y in zip(line.x[::3], line.y[::3], strict=True):
        s = path.closest(x, y, s)
        left.append(path.offset(x, y, s))
    assert np.abs(left).max() < 0.205
    assert speed_profile(line, PLANT, 5.0).time < 0.9 * speed_profile(path, PLANT, 5.0).time


@pytest.mark.slow
def test_a_minimum_time_line_is_repeatable_in_the_lane_and_no_slower(monkeypatch):
    monkeypatch.setattr(lines, "TRIES", 40)
    monkeypatch.setattr(lines, "START_WEIGHTS", ())
    path = track_named("savoiardo")
    line = minimum_time_line(path, 0.2, PLANT, 5.0)
    again = minimum_time_line(path, 0.2, PLANT, 5.0)
    assert np.array_equal(line.x, again.x)
    s = 0.0
    for x, y in zip(line.x[::3], line.y[::3], strict=True):
        s = path.closest(x, y, s)
        assert abs(path.offset(x, y, s)) < 0.205
    least_curvature = raceline(path, 0.2, PLANT, 5.0)
    assert (speed_profile(line, PLANT, 5.0).time
            <= speed_profile(least_curvature, PLANT, 5.0).time)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gain"), [("racetrack_vicon_2", 0.008), ("savoiardo", 0.001)])
@pytest.mark.long
def test_a_minimum_time_line_is_faster_and_driven_as_predicted(name, gain):
    path = track_named(name)
    line = minimum_time_line(path, 0.3, PLANT, 5.0)
    least_curvature = speed_profile(raceline(path, 0.3, PLANT, 5.0), PLANT, 5.0).time
    assert speed_profile(line, PLANT, 5.0).time < (1.0 - gain) * least_curvature
    for tracker in ("lqr", "mpcc"):
        predicted, driven, _, why = drive_laps(line, 5.0, tracker)
        assert why == "the path is driven"
        assert driven == pytest.approx(predicted, rel=0.03), tracker


def test_racelines_that_cannot_be():
    with pytest.raises(UsageError, match="closed path"):
        raceline(Path([(2.0, 0.0)], closed=False), 0.2, PLANT, 1.0)
    for width in (0.0, 0.7):
        with pytest.raises(UsageError, match="lane of this width"):
            raceline(track_named("savoiardo"), width, PLANT, 1.0)
