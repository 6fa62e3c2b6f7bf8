"""Stop before obstacles for every program: at the ESC's pin of a car that drives at a wall."""

from __future__ import annotations

from dataclasses import replace
from math import cos, inf, nan, pi, sin

import numpy as np
import pytest

from dart_hal.car import Car, obstacle_guard
from dart_hal.car.obstacle_guard import MAX_SCAN_AGE, distance_to_contact, distance_to_front
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Scan
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.lidar.maps import RoomMap, polyline
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

pytestmark = pytest.mark.usefixtures("armed_esc")

ROOM_URL = "sim://?nano=mock&physics=kinematic&lidar=1&map=room"
GUARD_DISTANCE = 0.4
# m from the rear axle at the start to the wall ahead.
WALL = 4.0
TEST_THROTTLE = 0.25


class Approach:
    """A car that a program drives straight at a wall; ``front``: distance left at its end [m]."""

    def __init__(self, guard_distance, seconds=8.0, throttle=TEST_THROTTLE, change=None,
                 lidar="1"):
        backend = open_backend(ROOM_URL.replace("lidar=1", f"lidar={lidar}"))
        self.world = world_of(backend)
        # A wall ahead and one far behind, in place of the room.
        walls = [polyline(np.array([(x, -3.0), (x, 3.0)])) for x in (WALL, -6.0)]
        backend.lidar.unit.set_room(
            RoomMap("wall", np.vstack(walls), np.zeros((0, 4)), (0.0, 0.0, 0.0)))
        if change is not None:
            change(backend)
        self.pulses = []
        self.world.watchers.append(self._watch)
        self.limited = set()
        self.speeds = []
        with Car.over(backend, guard_distance=guard_distance) as car:
            for state in car.states(duration=1.0):
                pass
            car.arm()
            for state in car.states(duration=seconds):
                self.limited |= set(car.drive(steering=0.0, throttle=throttle).limited)
                self.speeds.append(state.speed)
            self.end = self.world.truth()
            self.ended = self.world.t
            self.front = WALL - self.end.x - distance_to_front(car.files.config.geometry)

    def _watch(self, channel, pulse):
        if channel == THROTTLE_CHANNEL:
            self.pulses.append((pulse[1], (pulse[1] - pulse[0]) * 1e6))

    def forward(self, since=0.0):
        """Pulses of the ESC's pin above neutral."""
        return [us for t, us in self.pulses
                if t >= since and us > NEUTRAL_US + NEUTRAL_TOLERANCE_US]


@pytest.mark.parametrize("lidar", ["1", "ld19", "rplidar"])
def test_a_program_that_drives_at_a_wall_is_stopped_at_the_pin(lidar):
    guarded = Approach(GUARD_DISTANCE, lidar=lidar)
    assert max(guarded.speeds) > 1.0
    assert GUARD_DISTANCE - 0.05 < guarded.front < GUARD_DISTANCE + 0.6
    assert not guarded.forward(guarded.ended - 1.0)
    assert "OBSTACLE" in guarded.limited
    assert abs(guarded.end.v_x) < 0.05


def test_control_without_a_guard_it_would_hit_the_wall():
    free = Approach(None, seconds=5.0)
    assert free.front < 0.0
    assert free.forward(free.ended - 1.0)
    assert "OBSTACLE" not in free.limited


def test_a_lidar_that_falls_silent_stops_the_car():
    silent_from = 4.0

    def silence(backend):
        poll = backend.lidar.poll
        backend.lidar.poll = lambda now: poll(now) if now < silent_from else []

    silent = Approach(GUARD_DISTANCE, seconds=3.0, throttle=0.15, change=silence)
    assert silent.front > 1.0, "the wall alone would not have stopped it yet"
    assert silent.forward()
    assert not silent.forward(silent_from + MAX_SCAN_AGE + 0.25)


# Shares of beams without echo, of sectors without echo, and of packets lost on the line.
POOR = ["dropout=1", "dropout=0.9", "gap=6.2", "most=0.3", "lost=0.7"]


@pytest.mark.parametrize("lidar", POOR)
def test_a_lidar_that_shows_too_little_stops_the_car(lidar):
    poor = Approach(GUARD_DISTANCE, seconds=4.5, throttle=0.3, lidar=lidar)
    assert poor.front > 0.2
    assert "OBSTACLE" in poor.limited


@pytest.mark.parametrize("lidar", ["dropout=1", "gap=6.2"])
def test_control_if_any_scan_counted_it_would_hit_the_wall(lidar, monkeypatch):
    monkeypatch.setattr(obstacle_guard, "sees_ahead", lambda scans: True)
    assert Approach(GUARD_DISTANCE, seconds=4.5, throttle=0.3, lidar=lidar).front < 0.1


def test_a_lidar_that_loses_some_packets_lets_the_car_drive():
    lossy = Approach(GUARD_DISTANCE, lidar="lost=0.2")
    assert max(lossy.speeds) > 0.5
    assert GUARD_DISTANCE - 0.1 < lossy.front < GUARD_DISTANCE + 0.6


def test_a_wheel_speed_that_is_doubted_stops_the_car():
    """Of three edges two are lost: the car is three times as fast as its State has it."""
    backend = open_backend(f"{ROOM_URL}&fail=enc:wrong=0.3@0")
    with Car.over(backend, guard_distance=GUARD_DISTANCE) as car:
        car.arm()
        world = world_of(backend)
        fastest = 0.0
        for state in car.states(duration=4.0):
            limited = car.drive(steering=0.0, throttle=0.3).limited
            fastest = max(fastest, world.truth().v_x)
    assert state.health.speed_doubted
    assert "OBSTACLE" in limited
    assert fastest < 0.8
    assert world.truth().v_x < 0.05


def test_an_echo_that_the_car_has_reached_still_blocks():
    """Nearer than the lidar's range there are no new echoes: the last ones count."""
    with Car.open(f"{ROOM_URL}&seed=1") as car:
        guard = obstacle_guard.ObstacleGuard(GUARD_DISTANCE, car.files)
        state = next(iter(car.states()))
    front = distance_to_front(car.files.config.geometry)
    bearing = np.linspace(-pi, pi, 360)
    wall = Scan(0.0, 0.0, 8.0, np.zeros(360), bearing, (front + 0.02) / np.cos(bearing.clip(-1, 1)))
    reached = replace(state, t=0.2, speed=1.0, scan=wall, accel_x=0.0, yaw_rate=0.0)
    assert guard.blocks(reached)
    moved = guard._move_echoes(0.2, 1.0, 0.0)
    assert guard._free_distance(moved, 0.0) < 0.0


def test_backward_throttle_is_passed():
    backward = Approach(5.0, seconds=2.0, throttle=-0.2)
    assert min(us for _, us in backward.pulses if us > 0.0) < NEUTRAL_US - 20.0
    assert not backward.forward()


def test_raw_pulses_are_withheld_too():
    backend = open_backend(ROOM_URL)
    watched = []
    world_of(backend).watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL
                                      and watched.append((pulse[1] - pulse[0]) * 1e6))
    with Car.over(backend, guard_distance=8.0) as car, car.raw():
        for _ in car.states(duration=1.0):
            limited = car.pulses(steering_us=1500.0, throttle_us=1560.0).limited
    assert "OBSTACLE" in limited
    assert max(watched) < NEUTRAL_US + NEUTRAL_TOLERANCE_US


def nearest_echo_at_rest(seed, speed):
    """Distance [m] from the front to the nearest echo ahead, of a car that was not calibrated."""
    url = f"sim://?seed={seed}&nano=mock&lidar=1&map=room"
    with Car.open(url, guard_distance=GUARD_DISTANCE) as car:
        car.arm()
        for state in car.states(duration=6.0):
            car.drive_speed(steering=0.0, speed=speed)
        assert abs(state.speed) < 0.05
        x, y = state.scan.in_car().T
        front = distance_to_front(car.files.config.geometry)
        ahead = x[(np.abs(y) < 0.13) & (x > 0.13)]
        # At the wall the lidar is too near for an echo.
        return float(np.min(ahead)) - front if len(ahead) else 0.0


@pytest.mark.slow
def test_a_car_that_still_accelerates_and_turns_stops_before_the_wall():
    """Its motor lags, it rolls far, and its wheels are not straight at steering 0."""
    assert min(nearest_echo_at_rest(seed, 2.0) for seed in (2, 4, 5)) > 0.1


@pytest.mark.slow
def test_control_the_distance_of_rolling_out_alone_is_too_short(monkeypatch):
    monkeypatch.setattr(obstacle_guard, "MOTOR_TIME", 1e-9)
    monkeypatch.setattr(obstacle_guard, "GUARD_DECELERATION", 2.0)
    monkeypatch.setattr(obstacle_guard, "MIN_ARC_SPEED", inf)
    assert nearest_echo_at_rest(4, 2.0) < 0.1


@pytest.mark.parametrize("distance", [0.0, -0.1, nan, inf, 9.0, "0.3", True])
def test_what_is_no_distance_is_refused(distance):
    with pytest.raises(UsageError, match="guard_distance is no distance"):
        Car.open(ROOM_URL, guard_distance=distance)


def test_a_car_without_a_lidar_is_refused():
    with pytest.raises(UsageError, match="needs a lidar"):
        Car.open("sim://?nano=mock", guard_distance=0.3)


@pytest.mark.parametrize("curvature", [0.0, 0.7, -2.4])
def test_the_distance_to_contact_is_that_of_a_front_that_moves_along_the_arc(curvature):
    """Points of all places before the car, against the front moved in steps of 2 mm."""
    front, half = 0.24, 0.1
    rng = np.random.default_rng(3)
    points = np.column_stack((rng.uniform(front + 0.005, 0.9, 300), rng.uniform(-0.7, 0.7, 300)))
    found = distance_to_contact(points, curvature, front, half)
    true = np.full(len(points), inf)
    for way in np.arange(0.0, 0.7, 0.002):
        yaw = way * curvature
        x = sin(yaw) / curvature if curvature else way
        y = (1.0 - cos(yaw)) / curvature if curvature else 0.0
        dx, dy = (points - (x, y)).T
        ahead = cos(yaw) * dx + sin(yaw) * dy
        inside = (ahead <= front) & (ahead > 0.0) & (
            np.abs(cos(yaw) * dy - sin(yaw) * dx) < half)
        true[inside & np.isinf(true)] = way
    hit = np.isfinite(true)
    assert hit.sum() > 30
    assert np.all(found[hit] <= true[hit] + 0.003), "no point is detected too late"
    assert np.all(found[hit] >= true[hit] - 0.005), "and none too early"
    # Points that are grazed may be counted either way.
    assert np.mean(found[~hit] < 0.5) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("steering", "y"), [(-0.4, 0.08), (0.3, -0.08)])
def test_a_post_before_the_outer_corner_keeps_the_car_at_rest(tmp_path, steering, y):
    """It is at the side of the arc of the rear axle, and the front swings over it."""
    size = 600
    image = np.full((size, size), 254, np.uint8)
    image[[0, 1, 2, -3, -2, -1]] = 0
    image[:, [0, 1, 2, -3, -2, -1]] = 0
    row = round((y - 0.02 + 3.0) / 0.01)
    column = round((0.2375 + 0.03 + 3.0) / 0.01)
    image[row:row + 4, column:column + 4] = 0
    (tmp_path / "post.pgm").write_bytes(b"P5 600 600 255\n" + image[::-1].tobytes())
    (tmp_path / "post.yaml").write_text(
        "image: post.pgm\nresolution: 0.01\norigin: [-3.0, -3.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    url = f"sim://?nano=mock&seed=0&lidar=x4&map={tmp_path / 'post.yaml'}&at=0,0,0"
    with Car.open(url, guard_distance=0.4) as car:
        car.arm(waive=("CALIBRATION_MISSING",))
        begin = car.now
        for state in car.states(duration=3.0):
            car.drive(steering=steering, throttle=0.25 if state.t > begin + 0.6 else 0.0)
            assert state.applied.throttle == 0.0

