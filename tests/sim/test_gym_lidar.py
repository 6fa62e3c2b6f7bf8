"""DartCar-v0 with a lidar: what it sees of boards and other cars, and what touching one means."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from dart_hal.control.paths import Path
from dart_hal.control.tracks import TRACKS, track_named
from dart_hal.core.errors import UsageError
from dart_hal.estimation.localisation import rays
from dart_lab.sim.gym import DartCarEnv, DartCarVectorEnv, GymConfig
from dart_lab.sim.gym.lidar import (
    BOARD_OFFSET,
    CAR_OUTLINE,
    DEFAULT_MOUNT_X,
    MAX_CHORD_ERROR,
    MAX_RANGE,
    RangeSensor,
)
from dart_lab.sim.gym.tasks import OFF_TRACK_REWARD, Memory

RING = Path([(2.0 * pi, 1.0)], closed=True)
"""A circle of 1 m about (0, 1), begun at the origin along x."""
NO_CARS = np.empty((0, 3, 1))


def to_ring(x, y, way, radius):
    """Distance along ``way`` [rad] to a circle about (0, 1), inf past it."""
    x, y = x, y - 1.0
    b, c = x * cos(way) + y * sin(way), x * x + y * y - radius**2
    root = np.sqrt(complex(b * b - c))
    ways = [t.real for t in (-b - root, -b + root) if t.imag == 0.0 and t.real > 0.0]
    return min(ways, default=np.inf)


def test_boards_are_where_they_are():
    c = GymConfig(track=RING, beams=72)
    eyes, half = RangeSensor(RING, c), c.half_width + BOARD_OFFSET
    pose = 0.05, 0.1, 0.3
    distances = eyes.ranges(np.array(pose)[:, None], NO_CARS)[:, 0]
    x, y = pose[0] + DEFAULT_MOUNT_X * cos(pose[2]), pose[1] + DEFAULT_MOUNT_X * sin(pose[2])
    for reach, bearing in zip(distances, eyes.bearing, strict=True):
        way = pose[2] + bearing
        true = min(to_ring(x, y, way, 1.0 - half), to_ring(x, y, way, 1.0 + half))
        assert reach == pytest.approx(true, abs=6.0 * MAX_CHORD_ERROR)  # aslant it is further


@pytest.mark.parametrize("name", TRACKS)
def test_nothing_is_detected_through_the_boards(name):
    """But at the crossing of the eight, where they end."""
    track = track_named(name)
    eyes, at = RangeSensor(track, GymConfig(track=track, beams=36)), np.arange(0, len(track.x), 9)
    pose = np.array((track.x[at], track.y[at], track.heading[at]))
    distances = eyes.ranges(pose, np.empty((0, 3, len(at))))
    assert distances.min() > 0.2
    assert (distances == MAX_RANGE).mean() <= (0.01 if name == "eight" else 0.0)
    assert len(eyes.lines) < 300


def test_a_car_ahead_is_detected_and_one_behind_a_board_is_not():
    track = track_named("savoiardo")
    eyes = RangeSensor(track, GymConfig(track=track, beams=4))
    me, gap = np.array((0.3, 0.0, 0.0))[:, None], 1.0
    rear = 0.3 + DEFAULT_MOUNT_X + gap + 0.5 * CAR_OUTLINE.length - CAR_OUTLINE.ahead
    ahead = np.array((rear, 0.0, 0.0)).reshape(1, 3, 1)
    alone = eyes.ranges(me, NO_CARS)[:, 0]
    distances = eyes.ranges(me, ahead)[:, 0]
    assert distances[0] == pytest.approx(gap, abs=1e-9)
    assert alone[0] > gap + 0.5
    assert distances[1:] == pytest.approx(alone[1:])
    hidden = np.array((0.3, 1.6, pi)).reshape(1, 3, 1)
    assert eyes.ranges(me, hidden)[:, 0] == pytest.approx(alone)


@pytest.mark.slow
def test_the_numbers_before_are_the_same_and_the_noise_is_what_is_requested():
    plain, seeing = DartCarEnv(), DartCarEnv(beams=8, opponents=1)
    one, two = plain.reset(seed=4)[0], seeing.reset(seed=4)[0]
    assert seeing.names[17:] == ("range_0", "range_45", "range_90", "range_135", "range_180",
                                 "range_225", "range_270", "range_315")
    assert (one == two[:17]).all()
    exact = DartCarEnv(beams=8, opponents=1, range_noise=0.0).reset(seed=4)[0]
    noisy = np.array([DartCarEnv(beams=8, opponents=1, range_noise=0.1).reset(seed=4)[0][17:]
                      for _ in range(2)])
    assert (noisy[0] == noisy[1]).all()
    assert 0.02 < np.std(noisy[0] - exact[17:]) < 0.25
    many = DartCarVectorEnv(300, beams=8)
    first, second = (many.reset(seed=0)[0], many.step(np.zeros((300, 2)))[0])
    assert np.std((second - first)[:, 17 + 2], ddof=1) < 0.2


def test_touching_another_car_ends_the_episode():
    env = DartCarEnv(opponents=1, speed=1.0)
    for gap, touches in ((0.25, True), (0.5, False)):
        env.reset(seed=3)
        s = env._memory.s
        env._memory = Memory(s, (0.0, s + gap, 0.0))
        _, reward, terminated, _, info = env.step([0.0, 0.0])
        assert (terminated, bool(info["contact"])) == (touches, touches)
        assert (reward == OFF_TRACK_REWARD) is touches


def test_opponents_drive_on_and_are_caught():
    env = DartCarEnv(opponents=2)
    env.reset(seed=1)
    speed, first, *_ = env._memory.kept
    for _ in range(10):
        env.step([0.2, 0.0])
    assert env._memory.kept[1] == pytest.approx(first + 10 * 0.05 * speed)
    assert 0.3 * 1.5 <= speed <= 0.6 * 1.5


@pytest.mark.slow
def test_the_picture_shows_them():
    pictures = [DartCarEnv(opponents=k, render_mode="rgb_array") for k in (0, 3)]
    blue = []
    for env in pictures:
        env.reset(seed=2)
        blue.append(int((env.render() == (0, 114, 178)).all(axis=2).sum()))
    assert blue[0] == 0
    assert blue[1] > 300


def test_numpy_sees_what_the_kernel_sees(monkeypatch):
    distances = []
    for compiled in (rays.native_grid_cast(), None):
        monkeypatch.setattr(rays, "native_grid_cast", lambda compiled=compiled: compiled)
        distances.append(DartCarEnv(beams=24).reset(seed=6)[0])
    assert distances[0] == pytest.approx(distances[1], abs=1e-6)


@pytest.mark.parametrize("options", [
    {"beams": -1}, {"beams": 1000}, {"opponents": 9}, {"range_noise": -0.1},
    {"task": "speed", "beams": 8}, {"task": "speed", "opponents": 1}])
def test_what_cannot_be_is_refused(options):
    with pytest.raises(UsageError, match="lidar or opponents"):
        DartCarEnv(**options)
