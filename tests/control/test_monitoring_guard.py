"""Cars of a team do not meet: not where the curve crosses itself, not at any loss, not when one
falls silent; and the mode that each of them reports."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
import pytest

from dart_hal.control.follow import Phase
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.drivable import check_drivable, min_turn_radius, widen
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.guard import (
    MIN_BODY_DISTANCE,
    MIN_DISTANCE,
    CollisionGuard,
    CurveSection,
    reachable_section,
    stopping_section,
)
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.monitoring.monitor import MAX_RATE_FACTOR, Monitor, MonitorMode
from dart_hal.control.monitoring.peer import MAX_MESSAGE_AGE, PLAN_POINTS, PLAN_STEP, Contact, Peer
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose
from studies.control.light_follow import motion_at
from studies.control.monitoring_beads import NAMES, OMEGA, PLANT, TEAM, K, scenario

COURSE = Course(TEAM.curve)
GUARD = CollisionGuard(COURSE)
CROSSING = COURSE.arc_length(0.5 * pi)
"""m: the eight goes through 0, 0 there, and half a lap later."""
HALF_LAP = 0.5 * COURSE.path.length


@dataclass
class PhaseReport:
    """What came of another car's plan."""

    age: float
    points: np.ndarray
    step: float = PLAN_STEP


def make_plan_message(X, rate=OMEGA, age=0.0):
    spots = [COURSE.point_at(X + rate * PLAN_STEP * k) for k in range(PLAN_POINTS)]
    speed = rate * float(TEAM.curve.rate(np.array(X)))
    return PhaseReport(age, np.array([(p.x, p.y, p.heading, speed) for p in spots]))


def free(mine, its, v=1.0, its_v=1.0, age=0.05, **options):
    return GUARD.may_continue(
        mine, v, reachable_section(its, its_v, age, 2.0), **{"yields": False, **options}
    )


def test_two_that_come_to_a_crossing_at_once_do_not_both_go_on():
    """The one that gives way stops before it is in the way of the other."""
    for distance in np.arange(0.5, 1.0, 0.1):
        first = free(CROSSING - distance, CROSSING + HALF_LAP - distance - COURSE.path.length)
        second = free(CROSSING + HALF_LAP - distance, CROSSING - distance, yields=True)
        assert not (first and second)
    assert free(CROSSING - 3.0, CROSSING + HALF_LAP - 3.0 - COURSE.path.length)


def test_who_is_in_front_goes_on_and_who_is_behind_does_not():
    assert free(2.0, 1.5)
    assert free(2.0, 1.5, yields=True)
    assert not free(1.5, 2.0 - COURSE.path.length + COURSE.path.length, its_v=0.0)


def test_what_is_not_heard_makes_the_other_longer_until_it_is_in_the_way():
    its = CROSSING + HALF_LAP - 3.0 - COURSE.path.length
    assert free(CROSSING - 1.0, its, age=0.1)
    assert not free(CROSSING - 1.0, its, age=1.5, is_recent=False)
    lengths = [reachable_section(0.0, 0.5, age, 2.0).end for age in np.linspace(0.0, 5.0, 50)]
    assert (np.diff(lengths) > 0.0).all()
    assert reachable_section(0.0, 0.5, 5.0, 2.0).end <= 2.0 * 5.1 + stopping_section(0.0, 2.0).end


def test_a_car_in_a_crossing_may_leave_it():
    """Though another one is before it, nearer than the width of the bodies."""
    away = [CurveSection(CROSSING + HALF_LAP - d - COURSE.path.length,
                         CROSSING + HALF_LAP - d + 0.1 - COURSE.path.length) for d in (0.4, 0.5,
                                                                                       0.6)]
    assert all(GUARD.may_continue(CROSSING + 0.2, 0.0, other, yields=True) for other in away)


def test_in_the_formation_no_car_has_to_wait():
    """At 1.2 m/s, and with messages up to 0.3 s old: the curve separates the cars, not the
    guard."""
    rate = 1.2 / 3.76
    curve = TEAM.curve
    for X in np.linspace(0.0, 2.0 * pi, 24, endpoint=False):
        slots = TEAM.slots(X)
        s = COURSE.arc_length(X)
        v = rate * float(curve.rate(np.array(X)))
        for j in (1, 2):
            then = slots[j] - 0.3 * rate
            at = COURSE.arc_length(then % (2.0 * pi))
            at -= COURSE.path.length if at > s else 0.0
            other = reachable_section(at, rate * float(curve.rate(np.array(then))), 0.3, 2.4)
            assert GUARD.may_continue(s, v, other, yields=True)
    assert TEAM.distances().min_distance > MIN_DISTANCE + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "dies"), [(1, False), (2, True)])
def test_cars_that_begin_anywhere_spread_and_keep_their_distance(seed, dies):
    least, modes, error = scenario(seed, 0.3, 18.0, dies=dies)
    assert least > MIN_BODY_DISTANCE
    assert modes[MonitorMode.MONITORING] > 100
    if dies:
        assert modes[MonitorMode.ALONE] > 0
    else:
        assert error < 0.2


@pytest.mark.slow
def test_without_the_guard_they_meet():
    """The control: the others drive on into the one that has fallen silent."""
    assert scenario(2, 0.3, dies=True, guard=False)[0] < 0.19


# -- what is known of another car ----------------------------------------------------------


def test_a_phase_is_carried_on_by_the_plan_and_then_unknown():
    peer = Peer(COURSE)
    rate = 0.3
    assert peer.contact(0.0) is Contact.SILENT
    peer.receive(make_plan_message(1.0, rate, age=0.1), 10.0)
    ends = PLAN_STEP * (PLAN_POINTS - 1)
    for now, touch in (
        (10.0, Contact.IN_TOUCH),
        (9.9 + MAX_MESSAGE_AGE + 0.01, Contact.EXTRAPOLATED),
        (9.9 + ends - 0.01, Contact.EXTRAPOLATED),
        (9.9 + ends + 0.01, Contact.SILENT),
    ):
        assert peer.contact(now) is touch
        assert peer.phase(now) == pytest.approx(1.0 + rate * min(now - 9.9, ends), abs=2e-3)


def test_an_old_message_changes_nothing():
    peer = Peer(COURSE)
    peer.receive(make_plan_message(2.0), 10.0)
    peer.receive(make_plan_message(1.0, age=60.0), 10.1)
    assert peer.reported_X == pytest.approx(2.0, abs=1e-3)
    peer.receive(PhaseReport(0.0, np.empty((0, 4))), 10.2)
    assert peer.age(10.2) == pytest.approx(0.2)


# -- one car of the team --------------------------------------------------------------------


def robot(names=NAMES[:3], own="red", omega=OMEGA, team=TEAM, **options):
    return Monitor(team, names, own, PLANT, omega, K, **options)


def answer_messages(one, t, X, v, messages):
    spot = COURSE.point_at(X)
    return one.answer(motion_at(t, Pose(spot.x, spot.y, spot.heading), v, v * spot.curvature),
                      messages)


@pytest.mark.slow
def test_its_mode_is_reported():
    """From the first pose on: alone, spreading, in its slot, without its neighbour, alone."""
    one = robot()
    modes = []
    X = 1.7
    for k in range(90):
        t = 0.1 * k
        others = {}
        if 5 <= k < 50:
            off = 0.3 if k < 15 else 0.0
            others = {"green": make_plan_message(X + 2 * pi / 3 + off),
                      "blue": make_plan_message(X + 4 * pi / 3)}
        answer_messages(one, t, X, 0.5, others)
        X += 0.1 * one.rate
        if k and (not modes or modes[-1] is not one.mode):
            modes.append(one.mode)
    assert modes == [
        MonitorMode.ALONE,
        MonitorMode.SPREADING,
        MonitorMode.MONITORING,
        MonitorMode.EXTRAPOLATING,
        MonitorMode.ALONE,
    ]
    assert one.why == "green, blue"


def test_alone_it_waits_and_is_not_given_up():
    one = robot()
    speeds = [answer_messages(one, 0.1 * k, 0.1, 0.0, {}).speed for k in range(60)]
    assert not any(speeds)
    assert one.follower.phase is not Phase.ENDED


def test_its_speed_is_that_of_the_phase():
    """|dr/dX| X', faster where the neighbour behind is near, never beyond twice the formation's."""
    def speed(distance):
        one = robot()
        for k in range(3):
            answer_messages(one, 0.05 * k, 1.0, 0.5, {"blue": make_plan_message(1.0 + distance),
                                                      "green": make_plan_message(1.0 + 2 * pi / 3)})
        return one.rate, one.follower.cap

    rate, cap = speed(-2 * pi / 3)
    assert rate == pytest.approx(OMEGA, rel=0.02)
    assert cap == pytest.approx(OMEGA * float(TEAM.curve.rate(np.array(1.0))), rel=0.02)
    pushed, _ = speed(-1.5)
    assert pushed == pytest.approx(OMEGA + K * (np.sin(1.5) - np.sin(2 * pi / 3)), rel=0.02)
    assert OMEGA < pushed <= MAX_RATE_FACTOR * OMEGA


@pytest.mark.parametrize(("make", "match", "remedy"), [
    (lambda: robot(names=("red", "green")), "not the formation's", ""),
    (lambda: robot(names=("red", "green", "green")), "not the formation's", ""),
    (lambda: robot(omega=3.0), "cannot hold X' = 3.000", "omega="),
    (lambda: robot(team=Formation(Lissajous(1.5, 0.5, 1, 2), 3, 1)), "tighter than the car turns",
     "Lissajous("),
    (lambda: robot(team=Formation(TEAM.curve, 3, 1, 4)), "by their position", "Formation(curve, 3"),
])
def test_what_no_car_can_do_is_refused_with_what_to_type(make, match, remedy):
    with pytest.raises(UsageError, match=match) as refused:
        make()
    assert remedy in str(refused.value)


def test_what_is_to_be_typed_is_drivable():
    tight = Lissajous(0.8, 1.8, 5, 4)
    with pytest.raises(UsageError) as refused:
        check_drivable(tight, PLANT)
    wide = Lissajous(*(float(part) if "." in part else int(part) for part in
                       refused.value.remedy.partition("(")[2].partition(")")[0].split(", ")))
    check_drivable(wide, PLANT)
    assert wide.tightest == pytest.approx(min_turn_radius(PLANT), rel=2e-3)
    assert widen(wide, 0.1) == wide
