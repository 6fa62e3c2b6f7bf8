"""A simulated car with lifted wheels: they spin, its body rests, and hands can turn them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.friction import make_friction
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.motion import MotorForce
from dart_lab.sim.stand import LiftedCar
from dart_lab.sim.truth import world_of

TICK = 1e-3
URL = "sim://?nano=mock&seed=3"


def make_stand(seed=3, tick=TICK, **options):
    car = hidden_car(seed)
    return car, LiftedCar(car, MotorForce(car.vehicle), tick, **options)


@pytest.mark.parametrize("throttle", [0.25, 0.6, -0.5])
def test_at_a_steady_speed_the_pull_is_the_drive_trains_friction(throttle):
    car, wheels = make_stand()
    for _ in range(5000):
        speed = wheels.step(throttle, 0.0)
    drive = MotorForce(car.vehicle)
    drive.set_throttle(throttle)
    friction = car.drivetrain * make_friction(car.vehicle.friction)(speed)
    assert drive.k0 - drive.k1 * speed == pytest.approx(-friction, abs=1e-5)
    assert math.copysign(1.0, speed) == math.copysign(1.0, throttle)


def test_they_coast_by_mass_and_friction():
    """Against the closed form of v' = -(a + c v) / m above the knee of the dry friction."""
    car, wheels = make_stand(speed=2.0)
    seconds = 0.0
    while wheels.speed > 1.0:
        wheels.step(0.0, 0.0)
        seconds += TICK
    a, c = (car.drivetrain * v for v in (car.vehicle.friction.a, car.vehicle.friction.c))
    assert seconds == pytest.approx(car.wheel_mass / c * math.log((a + 2.0 * c) / (a + c)),
                                    abs=2 * TICK)


@pytest.mark.parametrize("tick", [1e-3, 1e-2])
def test_a_brake_stops_them_and_never_turns_them_back(tick):
    _, wheels = make_stand(speed=4.0, tick=tick)
    speeds = [wheels.step(0.0, 20.0) for _ in range(round(0.5 / tick))]
    assert np.all(np.diff(speeds) <= 1e-12)
    assert -1e-12 < speeds[-1] < 1e-3


def spun(url, lift=True, seconds=1.0, pulse=1600.0):
    """(States, world) of a car whose ESC gets a pulse for a while."""
    backend = open_backend(url)
    world = world_of(backend)
    with Car.over(backend) as car:
        if lift:
            backend.workshop.lift()
        with car.raw():
            states = []
            for state in car.states(duration=seconds):
                car.pulses(steering_us=1500.0, throttle_us=pulse)
                states.append(state)
        turned = backend.workshop.wheels_turned()
    return states, world, turned


@pytest.mark.parametrize("lift", [True, False])
@pytest.mark.slow
def test_the_body_rests_while_the_wheels_count(lift):
    states, world, turned = spun(URL, lift)
    accel = np.mean([s.accel_x for s in states[10:60]])
    assert states[-1].ticks - states[0].ticks > 100
    assert turned == 1
    assert (abs(accel) < 0.05) == lift
    assert (abs(world.truth().distance) < 1e-9) == lift


@pytest.mark.slow
def test_swapped_leads_turn_the_wheels_backward():
    assert spun(f"{URL}&fail=esc:wrong@0", seconds=0.6)[2] == -1


@pytest.mark.parametrize("fail", ["wheel:stuck", "esc:off"])
@pytest.mark.slow
def test_a_blocked_wheel_and_an_empty_battery_turn_nothing(fail):
    states, _, turned = spun(f"{URL}&fail={fail}@0", seconds=0.6)
    assert states[-1].ticks == states[0].ticks
    assert turned == 0


@pytest.mark.slow
def test_a_car_that_is_not_lifted_drives():
    _, world, _ = spun(f"{URL}&fail=stand:off@0", seconds=0.6)
    assert world.truth().distance > 0.05


@pytest.mark.parametrize(("lift", "fail", "edges"), [
    (True, "", 10), (False, "", 10), (True, "&fail=wheel:stuck@0", 0),
    (True, "&fail=enc:off@0", 0)])
@pytest.mark.slow_except("True--10")
def test_a_hand_turns_the_wheels(lift, fail, edges):
    backend = open_backend(URL + fail)
    with Car.over(backend) as car:
        if lift:
            backend.workshop.lift()
        first = next(iter(car.states()))
        free = backend.workshop.push()
        last = list(car.states(duration=1.5))[-1]
        assert free == ("stuck" not in fail)
        assert (last.ticks - first.ticks >= edges) if edges else last.ticks == first.ticks
        assert last.speed == 0.0
        backend.workshop.set_down()
        assert abs(world_of(backend).truth().v_x) < 0.01
