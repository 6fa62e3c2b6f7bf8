"""Cars in one world: each lidar sees the others where they are, and a contact is reported once."""

from __future__ import annotations

import logging
from math import cos, hypot, pi, sin

import numpy as np
import pytest

from dart_hal.car import Car, Fleet
from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend
from dart_lab.sim import arena
from dart_lab.sim.arena import CAR_OUTLINE, bodies_overlap
from dart_lab.sim.truth import room_of_car, truth, world_of

PLAIN = "sim://?nano=mock&seed={}&world={}&at={}"
QUIET = "&lidar=rate=7,noise=0,dropout=0,lost=0&map=corridor"


def pair(world, first, second, *, first_sees=""):
    return Fleet.open([PLAIN.format(1, world, first) + first_sees, PLAIN.format(2, world, second)])


def in_room(car, start):
    """(x, y, yaw) of the rear axle in the room, by the truth."""
    t = truth(car._engine.backend)
    c, s = cos(start[2]), sin(start[2])
    return start[0] + c * t.x - s * t.y, start[1] + s * t.x + c * t.y, start[2] + t.yaw


def middle(true, start):
    """Of the body of a car that began at ``at``."""
    c, s = cos(start[2]), sin(start[2])
    yaw = start[2] + true.yaw
    return (start[0] + c * true.x - s * true.y + CAR_OUTLINE.ahead * cos(yaw),
            start[1] + s * true.x + c * true.y + CAR_OUTLINE.ahead * sin(yaw), yaw)


def off_body(points, place):
    """Distance of points (n, 2) from the outline of a car at x, y, yaw of its rear axle [m]."""
    x, y, yaw = place
    c, s = cos(yaw), sin(yaw)
    d = points - (x, y)
    ahead = np.abs(c * d[:, 0] + s * d[:, 1] - CAR_OUTLINE.ahead) - 0.5 * CAR_OUTLINE.length
    left = np.abs(c * d[:, 1] - s * d[:, 0]) - 0.5 * CAR_OUTLINE.width
    outside = np.hypot(np.maximum(ahead, 0.0), np.maximum(left, 0.0))
    return np.where((ahead < 0) & (left < 0), -np.maximum(ahead, left), outside)


def hits(fleet, first, second, seconds=1.0):
    """Points of the first car's lidar in the room near the second one, and how far off they are."""
    car = fleet.cars[0]
    found = []
    for _ in fleet.states(duration=seconds):
        for scan in car.lidar.scans():
            start = in_room(car, first)
            here = in_room(fleet.cars[1], second)
            mount = car._engine.backend.lidar.unit._params.mount  # as it truly sits
            room = scan.mounted(mount).points(lambda t, start=start: np.tile(start, (len(t), 1)).T)
            room = room[~np.isnan(room).any(axis=1)]
            near = np.hypot(*(room - here[:2]).T) < 0.5
            found.append(off_body(room[near], here))
    return np.concatenate(found)


FIRST, SECOND = (4.0, 1.0, 0.0), (5.5, 1.0, 0.6)


@pytest.mark.slow
def test_the_lidar_sees_the_body_of_the_other():
    with pair("seen", "4,1,0", "5.5,1,0.6", first_sees=QUIET) as fleet:
        hit_beams = hits(fleet, FIRST, SECOND)
    assert len(hit_beams) > 60
    assert np.median(hit_beams) < 0.01
    assert np.quantile(hit_beams, 0.9) < 0.03


@pytest.mark.slow
def test_in_another_world_it_sees_the_wall_behind():
    """Control: the same cars, and nothing there."""
    urls = [PLAIN.format(1, "mine", "4,1,0") + QUIET, PLAIN.format(2, "yours", "5.5,1,0.6")]
    with Fleet.open(urls) as fleet:
        assert len(hits(fleet, FIRST, SECOND)) < 5


def test_all_of_a_world_are_in_one_room():
    cars = [open_backend(PLAIN.format(n, "same", f"{n},1,0") + "&lidar=1&map=room") for n in (3, 4)]
    rooms = [room_of_car(backend) for backend in cars]
    assert np.array_equal(rooms[0].lines, rooms[1].lines)
    assert [room.start for room in rooms] == [(3.0, 1.0, 0.0), (4.0, 1.0, 0.0)]
    for backend in cars:
        backend.close()


def test_a_contact_is_reported_when_it_begins_and_again_after_it_ended():
    """Two places by themselves: one drives through the other, away, and back into it."""
    found = arena.Arena("by itself")
    first, second = found.enter("red", (0.0, 0.0, 0.0)), found.enter("red", (1.0, 0.0, 0.0))
    second.trail(0.0, 0.0, 0.0, 0.0)
    way = [*range(0, 200), *range(200, 100, -1)]
    for k, start in enumerate(way):
        first.trail(0.005 * k, 0.01 * start, 0.0, 0.0)
    assert [c.cars for c in found.contacts] == [("red", "red-2")] * 2
    assert found.contacts[0].t == pytest.approx(0.005 * 70, abs=0.025)
    assert found.contacts[1].t == pytest.approx(0.005 * (200 + 70), abs=0.025)
    second.leave()
    first.trail(9.0, 1.0, 0.0, 0.0)
    assert len(found.contacts) == 2


@pytest.mark.slow
def test_cars_that_touch_are_reported_once(caplog):
    """The second is 1 m ahead of the first, which drives into it and through it."""
    with caplog.at_level(logging.WARNING), pair("crash", "0,0,0", "1,0,1.2") as fleet:
        fleet.arm()
        for _ in fleet.states(duration=3.0):
            fleet.cars[0].drive_speed(steering=0.0, speed=0.8)
        (contact,) = fleet.contacts
        assert fleet.cars[1].contacts == (contact,)
        assert set(contact.cars) == {"sim-1", "sim-2"}
        worlds = [world_of(car._engine.backend) for car in fleet.cars]
        overlaps = {late: bodies_overlap(*(middle(world.truth(contact.t + late), start) for world,
                                           start in
                                zip(worlds, ((0.0, 0.0, 0.0), (1.0, 0.0, 1.2)), strict=True)))
                    for late in (-0.025, 0.005)}
    assert overlaps == {-0.025: False, 0.005: True}, "when it began, within a look of 20 ms"
    assert sum("touch" in text for text in caplog.messages) == 1


@pytest.mark.slow
def test_cars_that_pass_do_not_touch():
    """Control: half a metre aside."""
    with pair("pass", "0,0,0", "1,0.5,0") as fleet:
        fleet.arm()
        for _ in fleet.states(duration=2.0):
            fleet.cars[0].drive_speed(steering=0.0, speed=0.8)
        assert fleet.contacts == ()


@pytest.mark.parametrize(("start", "touches"), [
    ((0.29, 0.0, 0.0), True), ((0.31, 0.0, 0.0), False), ((0.0, 0.18, 0.0), True),
    ((0.0, 0.20, 0.0), False), ((0.24, 0.0, pi / 2), True), ((0.25, 0.0, pi / 2), False),
    ((0.30, 0.19, 0.0), False), ((0.25, 0.19, pi / 4), True), ((0.33, 0.25, pi / 4), False)])
def test_two_bodies(start, touches):
    for turn in (0.0, 1.0):
        c, s = cos(turn), sin(turn)
        a, b = (1.0, 2.0, turn), (1.0 + c * start[0] - s * start[1],
                                  2.0 + s * start[0] + c * start[1],
                                  turn + start[2])
        assert bodies_overlap(a, b) is touches
        assert bodies_overlap(b, a) is touches
    assert hypot(*start[:2]) < 0.5


def test_a_world_does_not_change_its_cars():
    """The same drive alone and in company: the same States to the bit."""
    def drive(world):
        with Car.open(f"sim://?nano=mock&seed=1{world}") as car:
            return [(s.t, s.speed, s.pose.x) for s in car.states(duration=0.5)]

    with Car.open(PLAIN.format(2, "bits", "0,0,0")):
        assert drive("&world=bits&at=3,0,0") == drive("")


@pytest.mark.parametrize("options", ["world=lab", "world=lab&at=1,2", "world=&at=0,0,0",
                                     "at=0,0,0", "world=lab&at=nan,0,0"])
def test_a_place_that_is_none_is_refused(options):
    with pytest.raises(UsageError):
        open_backend(f"sim://?nano=mock&{options}")


def test_the_last_car_takes_its_world_with_it():
    with pair("gone", "0,0,0", "2,0,0"):
        assert "gone" in arena._arenas
    assert "gone" not in arena._arenas


@pytest.mark.slow
def test_one_motion_capture_sees_all_cars_of_a_room():
    """In the room's frame: where ``start`` puts it, but for the marker, which was not measured."""
    places = (1.0, 2.0, 0.5), (3.0, -1.0, 2.0)
    texts = [",".join(map(str, start)) + "&mocap=1" for start in places]
    with pair("seen", *texts) as fleet:
        for states in fleet.states(duration=0.5):
            pass
        for state, start in zip(states, places, strict=True):
            assert state.estimate.frame == "mocap"
            pose = state.estimate.pose
            assert hypot(pose.x - start[0], pose.y - start[1]) < 0.3
            assert abs(pose.yaw - start[2]) < 0.1
