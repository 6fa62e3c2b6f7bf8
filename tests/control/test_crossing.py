"""Cars of a crossing: never nearer than they may be, across in time, and every way to wait has a
name; what is wrong with a layout or a message is reported."""

from __future__ import annotations

from functools import cache, partial
from math import inf

import numpy as np
import pytest

from dart_hal.control.crossing import layouts, order
from dart_hal.control.crossing.coordinator import Coordinator, CrossingWait
from dart_hal.control.crossing.crosser import Crosser
from dart_hal.control.crossing.layout import CrossingLayout
from dart_hal.control.crossing.message import MessageFault, decode, encode
from dart_hal.control.crossing.order import CrossingPhase, MessageVerdict, Precedence
from dart_hal.control.crossing.speed import safe_speed, sendable_throttle, stopping_distance
from dart_hal.core.errors import UsageError
from dart_hal.core.types import START_FRAME, Pose, Tracking
from dart_hal.vehicle.sets import UPSTREAM_2024
from studies.control import crossing_light as light
from studies.control.crossing_figures import campaign
from studies.control.crossing_light import Faults, Network, Start
from studies.control.light_follow import motion_at, plant_by

LEAST = 0.35


@cache
def layout(name="intersection"):
    """Of the intersection the four ways straight on."""
    made = layouts.LAYOUTS[name]()
    if name != "intersection":
        return made
    return CrossingLayout(
        name, tuple(r for r in made.routes if r.name in light.STRAIGHT), layouts.DEFAULT_SPEED
    )


NO_FAULTS = Faults()


def four(kind="near", seed=1, loss=0.0, faults=NO_FAULTS, seconds=25.0, name="intersection",
         make=light.coordinator, ends=True):
    starts = light.arrivals(layout(name), seed, kind)
    network = Network(np.random.default_rng([seed, 5]), 4, loss)
    return light.drive(layout(name), starts, network, seconds, faults, make, ends)


@pytest.mark.parametrize("kind", ["symmetric", "near"])
@pytest.mark.slow
def test_all_cross_in_time_though_half_of_the_messages_are_lost(kind):
    run = four(kind, loss=0.5)
    assert run.least > LEAST
    assert max(run.across) < 12.0
    assert {CrossingWait.FOR_CAR, CrossingWait.GOING} <= light.waits(run)


@pytest.mark.parametrize(("name", "loss", "bursts", "within"), [
    ("intersection", 0.0, 0.0, 12.0), ("intersection", 0.3, 0.0, 12.0),
    ("intersection", 0.5, 0.0, 12.0), ("intersection", 0.8, 0.0, 18.0),
    ("merge", 0.5, 0.0, 12.0), ("roundabout", 0.5, 0.0, 20.0), ("intersection", 0.0, 0.5, 25.0),
])
@pytest.mark.slow
@pytest.mark.long_except("intersection-0.0*", "intersection-0.8*", "roundabout*", "merge*")
def test_arrivals(name, loss, bursts, within):
    least, last = campaign(layout(name), 20, loss, bursts)
    assert least.min() > LEAST
    assert last.max() < within


@pytest.mark.parametrize(("name", "loss", "within"), [
    ("intersection", 0.0, 12.0), ("intersection", 0.3, 12.0), ("intersection", 0.5, 12.0),
    ("intersection", 0.8, 18.0), ("merge", 0.5, 12.0), ("roundabout", 0.5, 20.0),
])
@pytest.mark.long
def test_two_hundred_arrivals(name, loss, within):
    least, last = campaign(layout(name), 200, loss)
    assert least.min() > LEAST
    assert last.max() < within


# -- silence, death, restart ---------------------------------------------------------------------

@pytest.mark.slow
def test_without_any_message_all_wait_before_the_ground_and_name_who_is_silent():
    run = four(loss=1.0, seconds=6.0)
    entry = layout().entry[0]
    assert run.least > LEAST
    assert all(entry - 0.1 < s < entry + 0.03 for s in run.rows[-1][1:]), "3 cm of pose and roll"
    assert all(car.events[-1][1] is CrossingWait.SILENT for car in run.cars)
    assert all(car.events[-1][2] for car in run.cars)


@pytest.mark.parametrize("place", [2.4, 3.3, 4.2])
@pytest.mark.slow
def test_who_meets_a_dead_car_waits_for_it_by_name(place):
    """Its computer does nothing from there on, and it rolls out: before the ground, on it, behind
    it."""
    alone = [Start("S-N", 1.0), Start("E-W", 0.3, 3), Start("N-S", 0.3, 5), Start("W-E", 0.0, 7)]
    run = light.drive(layout(), alone, Network(np.random.default_rng(3), 4), 9.0,
                      Faults(dead=(0, place)), ends=False)
    assert run.least > LEAST
    if place < 4.0:
        stuck = [car for k, car in enumerate(run.cars) if run.across[k] == inf and k]
        assert stuck
        assert {car.events[-1][1:] for car in stuck} & {(CrossingWait.SILENT, "car-0")}


@pytest.mark.slow
def test_who_goes_silent_is_waited_for_where_it_was_heard_last():
    run = four(faults=Faults(mute=(0, 1.5)), seconds=8.0)
    assert run.least > LEAST


@pytest.mark.parametrize(("when", "keeps"), [(1.0, True), (2.5, True), (2.5, False), (3.5, False)])
@pytest.mark.slow
def test_a_car_that_restarts_is_safe_and_goes_on_with_its_stamp(when, keeps):
    run = four("symmetric", faults=Faults(restart=(0, when, 1.5, keeps)), seconds=30.0)
    assert run.least > LEAST
    if keeps:
        assert max(run.across) < 30.0
    else:
        ended = run.cars[0]
        assert ended.phase in (CrossingPhase.BACK, CrossingPhase.DONE)
        assert ended.phase is CrossingPhase.DONE or ended.events[-1][1] is CrossingWait.STRANDED


# -- negative controls ---------------------------------------------------------------------------

@pytest.mark.slow
def test_without_acknowledgement_they_touch(monkeypatch):
    """The smallest stamp goes, of those that were heard: with 90 % of the messages lost one was
    not. The bodies are 0.3 m long and 0.2 wide."""
    assert four("near", 5, loss=0.9, seconds=9.0).least > LEAST
    right = order.precedence
    monkeypatch.setattr(order, "precedence", lambda car, j: Precedence.AFTER
                        if right(car, j) is Precedence.AFTER else Precedence.GRANTED)
    monkeypatch.setattr(order, "first_unaware", lambda car: None)
    assert four("near", 5, loss=0.9, seconds=9.0).least < 0.2


class MidPlane:
    """No order: each keeps to its half of the plane amid two plans, stage by stage."""

    AHEAD = 20
    WITHIN = 1.5

    def __init__(self, cars):
        self.cars = cars
        self.plans = [self.plan(car, 0.0) for car in cars]

    @staticmethod
    def plan(car, speed):
        """Middles (20, 2) at a speed that is come to by 2 m/s2."""
        t = 0.1 * np.arange(1, MidPlane.AHEAD + 1)
        change = speed - car.v
        ramp = np.minimum(t, abs(change) / 2.0)
        way = car.v * t + np.sign(change) * (ramp * t - 0.5 * ramp**2) * 2.0
        return np.array([car.path.interpolate(car.s + w)[:2] for w in np.maximum(way, 0.0)])

    def speed(self, i, most):
        """The highest of some speeds whose plan is in every half plane."""
        for v in np.linspace(most, 0.0, 11):
            own = self.plan(self.cars[i], v)
            if all(self.holds(i, j, own) for j in range(len(self.cars)) if j != i):
                return v
        return 0.0

    def holds(self, i, j, own):
        last = self.plans[i]
        other = self.plans[j]
        difference = last - other
        size = np.hypot(*difference.T)
        n = difference / np.maximum(size, 1e-9)[:, None]
        beyond = np.sum(n * (own - 0.5 * (last + other)), axis=1)
        return bool(np.all((beyond >= 0.5 * layout().min_distance) | (size > self.WITHIN)))


@pytest.mark.slow
def test_by_mid_planes_alone_four_symmetric_cars_wait_for_ever():
    """Without any loss: the order is what lets them cross, not the distance."""
    cars = [light.LightDrive(layout(), Start(route, 0.3)) for route in light.STRAIGHT]
    law = MidPlane(cars)
    for _ in range(100):
        speeds = [law.speed(i, 1.0) for i in range(4)]
        for car, speed in zip(cars, speeds, strict=True):
            car.decide(float(speed))
            for _ in range(light.EVERY):
                car.move()
        law.plans = [law.plan(car, v) for car, v in zip(cars, speeds, strict=True)]
    assert all(2.0 < car.s < layout().exit[0] for car in cars)
    assert all(car.v < 0.01 for car in cars)


# -- layouts and laws ------------------------------------------------------------------------------

@pytest.mark.slow
def test_lanes_that_are_too_near_to_each_other_are_refused():
    with pytest.raises(UsageError, match="too near to each other") as e:
        layouts.intersection(lane_offset=0.15)
    assert "a distance of 0.30 m" in str(e.value)


def test_a_start_too_near_to_stop_is_refused():
    entry = layout().entry[0]
    layout().check_start(0, entry - stopping_distance(1.0) - 0.01)
    with pytest.raises(UsageError, match="starts too near"):
        Coordinator(layout(), ("a", "b"), "a", "S-N", entry - 0.5, 1)
    with pytest.raises(UsageError, match="no route S-X"):
        Coordinator(layout(), ("a", "b"), "a", "S-X", 0.0, 1)


def test_the_line_never_falls_and_keeps_the_distance():
    made = layout()
    for a in range(2):
        for b in range(4):
            path = made.routes[a].path
            s = made.routes[a].path.s
            line = np.array([made.line(a, place, b) for place in s])
            assert np.all(np.diff(line[np.isfinite(line)]) >= 0.0)
            for place, most in zip(s[::20], line[::20], strict=True):
                own = made.routes[b].path
                free = own.s < min(most, own.length) - 1e-9
                point = path.interpolate(place)
                here = np.hypot(own.x[free] - point.x, own.y[free] - point.y)
                assert here.min(initial=1.0) >= made.min_distance - 1e-9


def test_from_the_safe_speed_a_car_stops_before_the_line():
    """0.3 s late, at 0.8 m/s2; what is left is the margin."""
    s = 0.0
    v = 1.0
    dt = 0.001
    late = [1.0] * 300
    while v > 1e-3 and s < 3.0:
        late.append(float(safe_speed(2.0 - s)))
        v = max(min(late.pop(0), v), v - 0.8 * dt)
        s += v * dt
    assert 1.8 < s < 2.0
    assert float(safe_speed(stopping_distance(1.0))) == pytest.approx(1.0)
    assert float(safe_speed(-inf)) == 0.0
    assert sendable_throttle(0.164, 0.1638) == 0.0
    assert sendable_throttle(0.2, 0.1638) == 0.2


# -- bad input -------------------------------------------------------------------------------------

CAR_NAMES = ("a", "b")


def pair():
    make = partial(Coordinator, layout(), CAR_NAMES)
    return make("a", "S-N", 1.0, 11), make("b", "E-W", 1.0, 12)


def meet(a, b, t=0.0):
    for x, y in ((a, b), (b, a), (a, b)):
        x.step(t, 1.0)
        y.receive(x.next_message(), t)
    b.step(t, 1.0)
    a.receive(b.next_message(), t)


def test_messages_out_of_order_twice_or_a_minute_old_are_counted():
    a, b = pair()
    first = b.next_message()
    second = b.next_message()
    assert a.receive(second, 60.0, age=60.0) is MessageVerdict.TAKEN
    assert a.receive(first, 60.0) is MessageVerdict.OLDER
    assert a.receive(second, 60.0) is MessageVerdict.OLDER
    assert a.counts == {"TAKEN": 1, "OLD": 1, "OLDER": 2}
    assert a.receive(a.next_message(), 60.0) is MessageVerdict.OWN
    assert a.counts["OLDER"] == 3  # passed on behind it


def test_a_session_that_was_followed_is_not_heard_again():
    a, b = pair()
    late = b.next_message()
    newer = Coordinator(layout(), CAR_NAMES, "b", "E-W", 1.0, 13)
    a.receive(b.next_message(), 0.0)
    a.receive(newer.next_message(), 0.1)
    assert a.receive(late, 0.2) is MessageVerdict.RETIRED


def three():
    """a, b, c, and b heard by the others before c is."""
    names = ("a", "b", "c")
    return [Coordinator(layout(), names, own, route, 1.0, 11 + k)
            for k, (own, route) in enumerate(zip(names, ("S-N", "E-W", "N-S"), strict=True))]


def test_what_another_passes_on_is_taken_once_its_session_is_known():
    a, b, c = three()
    b.receive(c.next_message(), 0.0)
    assert a.receive(b.next_message(), 0.1) is MessageVerdict.TAKEN
    assert (a.counts["TAKEN"], a.counts["UNMET"]) == (1, 1)
    assert a.car.others[2] is None
    a.receive(c.next_message(), 0.2)
    b.receive(c.next_message(), 0.3)
    a.receive(b.next_message(), 0.4)
    assert a.car.others[2].seq == 3
    assert (a.counts["TAKEN"], a.counts["UNMET"]) == (4, 1)


def test_a_session_that_is_over_is_not_begun_again_by_who_passes_it_on():
    """b heard the session of c before; a knows the new one alone, and keeps it."""
    a, b, c = three()
    b.receive(c.next_message(), 0.0)
    newer = Coordinator(layout(), c.names, "c", "N-S", 1.0, 99)
    a.receive(newer.next_message(), 0.1)
    a.receive(b.next_message(), 0.2)
    assert a.car.others[2].boot == 99
    assert a.counts["UNMET"] == 1


def test_what_is_passed_on_may_be_broken():
    a, b, c = three()
    b.receive(c.next_message(), 0.0)
    sent = b.next_message()
    assert a.receive(sent[:-60] + b"\xff" * 60, 0.1) is MessageVerdict.TAKEN
    assert a.counts["NUMBER"] == 1


@pytest.mark.parametrize(("cars", "size"), [(4, 162), (7, 234), (8, 129), (16, 225)])
def test_messages_are_passed_on_where_there_is_room(cars, size):
    names = tuple(f"c{k}" for k in range(cars))
    a, b = (Coordinator(layout(), names, own, "S-N", 1.0, 5) for own in names[:2])
    a.receive(b.next_message(), 0.0)
    assert len(a.next_message()) == size


class OneWay(Network):
    """From the second second on nothing comes from car 0 to car 1."""

    def silent(self, k, i, j):
        return (i, j) == (0, 1) and k * light.STEP > 1.0


@pytest.mark.parametrize("passes", [True, False])
@pytest.mark.slow
def test_a_way_that_carries_nothing_any_more_is_gone_around(passes, monkeypatch):
    """Without what the others pass on, the car is waited for as long as one looks."""
    if not passes:
        monkeypatch.setattr(Coordinator, "_next_relayed", lambda self: b"")
    starts = light.arrivals(layout(), 1, "near")
    run = light.drive(layout(), starts, OneWay(np.random.default_rng(5), 4), 25.0)
    assert run.least > LEAST
    assert (max(run.across) < 12.0) is passes


def test_a_neighbour_that_never_answers_is_named():
    a, _ = pair()
    assert a.step(0.0, 1.0).wait is CrossingWait.GOING
    assert a.step(0.5, 2.4)[1:] == (CrossingWait.TO_BE_KNOWN, "b")
    answer = a.step(3.0, 2.5)
    assert answer[1:] == (CrossingWait.SILENT, "b")
    assert answer.line == layout().entry[0]


def test_each_way_to_wait_has_its_name():
    a, b = pair()
    meet(a, b)
    assert (a.phase, b.phase) == (CrossingPhase.WANT, CrossingPhase.WANT)
    waits = {m.step(0.1, 2.5).wait for m in (a, b)}
    assert waits <= {CrossingWait.FOR_GRANT, CrossingWait.FOR_CAR, CrossingWait.GOING}
    follower = Coordinator(layout(), CAR_NAMES, "a", "S-N", 0.0, 11, leader="b")
    assert follower.step(0.0, 2.3)[1:] == (CrossingWait.FOR_LEADER, "b")
    assert follower.step(0.1, 1.0, free=0.5).wait is CrossingWait.FOLLOWING
    lost = Coordinator(layout(), CAR_NAMES, "a", "S-N", 3.0, 14, stored_stamp=0)
    assert lost.step(0.0, 3.0) == (3.0, CrossingWait.STRANDED, "")


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda d: b"\x09" + d[1:], MessageFault.VERSION),
        (lambda d: d[:1] + b"\0\0\0\0" + d[5:], MessageFault.KEY),
        (lambda d: d[:20], MessageFault.LENGTH),
        (lambda d: d + b"x", MessageFault.LENGTH),
        (lambda d: d[:8] + b"\x07" + d[9:], MessageFault.NUMBER),
        (lambda d: d[:25] + np.array([np.nan]).tobytes() + d[33:], MessageFault.NUMBER),
        (lambda d: d[:17] + b"\xff" * 8 + d[25:], MessageFault.NUMBER),
    ],
)
def test_bytes_that_are_no_message_are_named_and_counted(spoil, fault):
    a, b = pair()
    assert a.receive(spoil(b.next_message()), 0.0) is fault
    assert a.counts == {fault.value: 1}
    assert a.car.others == (None, None)


def test_a_message_survives_its_bytes():
    _, b = pair()
    _, message = order.next_message(b.car)
    assert decode(encode(message, 7), 7) == message
    with pytest.raises(UsageError, match="too many cars"):
        encode(message._replace(grants=(0,) * 17), 7)


@pytest.mark.parametrize("late", [0.0, 2.0])
def test_a_car_without_a_pose_is_silent_and_at_no_place_of_the_crossing(late):
    """Dead reckoning begins at the origin, which is the middle of each layout."""
    where = layout()
    cars = [Crosser(Coordinator(where, ("A", "B"), name, where.routes[k].name, 0.3, 11 + k),
                    plant_by(UPSTREAM_2024)) for k, name in enumerate(("A", "B"))]
    spots = [car.path.interpolate(0.3) for car in cars]
    sent = [0, 0]
    for step in range(100):
        t = 0.03 * step
        for k, car in enumerate(cars):
            pose = Pose(spots[k].x, spots[k].y, spots[k].heading)
            motion = motion_at(t, pose, 0.0, 0.0)
            if k == 0 and t < late:
                motion = motion_at(t, Pose(), 0.0, 0.0, Tracking.DEAD_RECKONING, START_FRAME)
            command = car.answer(motion, [])
            sent[k] += bool(command.message)
            if k == 0 and t < late:
                assert command == (0.0, 0.0, b"")
    assert cars[0].coordinator.car.s_minus < 1.0
    assert sent[0] >= 5
    assert sent[1] > sent[0] or not late


def test_a_car_off_its_route_stops_and_gives_the_reason():
    where = layout()
    car = Crosser(Coordinator(where, ("A", "B"), "A", where.routes[0].name, 0.3, 11),
                  plant_by(UPSTREAM_2024))
    spot = car.path.interpolate(0.3)
    left = np.array((-np.sin(spot.heading), np.cos(spot.heading)))
    for step, offset in enumerate((0.0, 0.1, 0.35)):
        x, y = np.array((spot.x, spot.y)) + offset * left
        command = car.answer(motion_at(0.02 * step, Pose(x, y, spot.heading), 0.3, 0.0), [])
        assert ("from its route" in car.why) == (offset > 0.3)
    assert command.speed == 0.0
