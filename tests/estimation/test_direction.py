"""The direction of a car that rolls without throttle: by its acceleration, at the emulated car
too."""

from __future__ import annotations

import math
import random

import pytest

from dart_hal import Car
from dart_hal.core.types import Doubt
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation import WheelSpeed
from dart_hal.estimation.direction import InertialDirection
from dart_lab.sim.truth import world_of

DIRECTION_PERIOD = 0.01


def run_frames(speeds, accelerations):
    """The direction in each frame of |v| [m/s] and a_x [m/s2]."""
    direction = InertialDirection()
    return [direction.add(DIRECTION_PERIOD, v, a) for v,
            a in zip(speeds, accelerations, strict=True)]


def ramp(rate, seconds, start=0.0):
    return [start + rate * k * DIRECTION_PERIOD for k in range(round(seconds / DIRECTION_PERIOD))]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("rate", [1.0, 3.0, -3.0])
@pytest.mark.parametrize("tilt", [0.3, 0.0, -0.3])
def test_the_acceleration_decides_the_sign(sign, rate, tilt):
    rng = random.Random(1)
    speeds = [max(v, 0.0) for v in ramp(rate, 0.8, 0.0 if rate > 0.0 else 2.4)]
    directions = run_frames(speeds, [sign * rate + tilt + rng.gauss(0.0, 0.3) for _ in speeds])
    assert -sign not in directions
    assert directions[45] == sign


@pytest.mark.parametrize("tilt", [0.5, -0.5])
def test_no_direction_is_given_for_a_steady_car(tilt):
    rng = random.Random(2)
    assert not any(run_frames([2.0 + rng.gauss(0.0, 0.03) for _ in range(300)], [tilt] * 300))


def test_wheels_that_slip_are_no_witness():
    """They spin up by 10 m/s2 while the car gains 2; they catch again while it still gains."""
    assert not any(run_frames(ramp(10.0, 0.4), [2.0] * 40))
    assert not any(run_frames(ramp(-6.0, 0.4, 4.0), [2.0] * 40))


def test_a_turn_within_the_window_gives_no_wrong_direction():
    """1 m/s, -10 m/s2 through zero: forwards until 0.1 s, then backwards."""
    speeds = [1.0] * 50 + [abs(1.0 - 10.0 * k * DIRECTION_PERIOD) for k in range(60)]
    directions = run_frames(speeds, [0.0] * 50 + [-10.0] * 60)
    assert -1 not in directions[:60]
    assert 1 not in directions[65:]
    assert directions[-1] == -1


def test_without_acceleration_no_direction_is_given():
    assert not any(run_frames(ramp(3.0, 1.0), [None] * 100))


def roll_car(wheel, hint, sign, seconds=1.5, rate=1.2, stood=0.5, believed=True):
    """A car at rest, then is accelerated by ``sign * rate``; the estimator at the end."""
    ring = wheel(0.002, 20, None, lambda t: 0.5 * rate * max(t - stood, 0.0)**2, stood + seconds)
    estimator = WheelSpeed(0.002, 20)
    direction = InertialDirection()
    for k in range(1, round((stood + seconds) / DIRECTION_PERIOD)):
        now = k * DIRECTION_PERIOD
        speed, _ = estimator.update(*ring.frame(now), 1.0, hint)
        directions = direction.add(DIRECTION_PERIOD, speed, sign * rate if now > stood else 0.0)
        if believed:
            estimator.correct_direction(directions)
    return estimator


@pytest.mark.parametrize("hint", [0, 1])
def test_a_car_that_rolls_backwards_from_rest_is_detected(wheel, hint):
    """At neutral, or down a slope against a weak throttle: travel goes back to the rest."""
    estimator = roll_car(wheel, hint, -1)
    assert estimator.speed == pytest.approx(-1.8, abs=0.05)
    assert estimator.distance == pytest.approx(-0.5 * 1.2 * 1.49**2, abs=0.03)
    assert estimator.ambiguous == (hint == 1)


def test_control_without_feeling_it_rolls_forwards(wheel):
    estimator = roll_car(wheel, 0, -1, believed=False)
    assert estimator.speed > 1.7
    assert estimator.ambiguous


def test_a_push_forwards_becomes_certain(wheel):
    estimator = roll_car(wheel, 0, 1)
    assert estimator.speed == pytest.approx(1.8, abs=0.05)
    assert not estimator.ambiguous


def test_a_certain_direction_is_not_overruled(wheel):
    """At speed, driven forwards: wheels that catch again look like a car that goes backwards."""
    ring = wheel(0.002, 20, None, lambda t: 2.0 * t, 3.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 290):
        estimator.update(*ring.frame(k * DIRECTION_PERIOD), 1.0, 1)
        estimator.correct_direction(-1 if k > 200 else 0)
    assert estimator.speed == pytest.approx(2.0, rel=0.02)


def to_and_fro(wheel, believed=True):
    """A hand pushes with +-3 m/s2, 1 s each way and no rest: (wrong, wrong and certain), frames."""
    def speed(t):
        return 3.0 * abs((t + 0.5) % 2.0 - 1.0) - 1.5

    at = [0.0]
    for k in range(1, round(8.0 / 2e-4)):
        at.append(at[-1] + abs(speed(k * 2e-4)) * 2e-4)
    ring = wheel(0.002, 20, None, lambda t: at[min(round(t / 2e-4), len(at) - 1)], 7.9)
    estimator = WheelSpeed(0.002, 20)
    direction = InertialDirection()
    wrong = silent = 0
    for k in range(1, 780):
        now = k * DIRECTION_PERIOD
        v, _ = estimator.update(*ring.frame(now), 1.0, 0)
        directions = direction.add(DIRECTION_PERIOD, v,
                                   (speed(now) - speed(now - DIRECTION_PERIOD)) / DIRECTION_PERIOD)
        if believed:
            estimator.correct_direction(directions)
        wrong += v * speed(now) < 0.0 and abs(v) > 0.3
        silent += v * speed(now) < 0.0 and abs(v) > 0.3 and not estimator.is_direction_uncertain
    return wrong, silent


def test_a_hand_that_turns_the_car_round_without_a_rest(wheel):
    """A third of the time at most until it is measured, and that is reported."""
    wrong, silent = to_and_fro(wheel)
    assert wrong < 250
    assert silent < 60
    assert to_and_fro(wheel, believed=False)[0] > 300


def test_a_push_too_weak_to_decide_is_uncertain(wheel):
    """0.3 m/s2: as much as a tilt that the fusion has not found."""
    estimator = roll_car(wheel, 0, -1, rate=0.3)
    assert estimator.is_direction_uncertain
    assert not roll_car(wheel, 0, -1).is_direction_uncertain


@pytest.mark.slow_except("1.0-3")
@pytest.mark.parametrize(("way", "seed"), [
    (-1.0, 3), (1.0, 3), pytest.param(-1.0, 8, marks=pytest.mark.slow)])
def test_an_emulated_car_pushed_at_neutral(way, seed):
    backend = open_backend(f"sim://?seed={seed}&nano=mock")
    world = world_of(backend)
    with Car.over(backend) as car:
        for _ in car.states(duration=0.5):
            pass
        start = world.truth()
        world.motion.drive.push = way * 6.0
        states = list(car.states(duration=0.5))
        world.motion.drive.push = 0.0
        state = states[-1]
        moved = math.copysign(math.hypot(world.truth().x - start.x, world.truth().y - start.y), way)
    assert state.pose.x == pytest.approx(moved, abs=0.03 + 0.03 * abs(moved))
    assert math.copysign(1.0, state.speed) == way
    assert abs(moved) > 0.1
    is_direction_uncertain = [Doubt.DIRECTION_UNSURE.value in s.health.doubts for s in states]
    assert any(is_direction_uncertain)
    assert not is_direction_uncertain[-1]
