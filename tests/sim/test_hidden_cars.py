"""Hidden cars: within their bounds, different, repeatable; and what is revealed."""

from __future__ import annotations

import json
import math
import statistics
from dataclasses import replace

import pytest

from dart_hal.core.config import parse_config
from dart_hal.core.config.calibration import QUANTITIES
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import PAPER, check_monotone, make_steering
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.truth import reveal, reveal_url

SEEDS = range(1, 101)


def test_no_seed_is_the_nominal_paper_car():
    car = hidden_car(None)
    assert car == hidden_car(0)
    assert replace(car.vehicle, name="paper", delay=PAPER.delay,
                   tyres=PAPER.tyres) == PAPER
    assert (car.servo.backlash, car.clock_error, car.oscillator_hz) == (0.0, 0.0, 25e6)
    assert (car.imu.gyro_bias, car.imu.gyro_noise) == ((0.0, 0.0, 0.0), 0.0)
    assert car.ring_a.fractions == pytest.approx([1.0] * 20)


@pytest.mark.parametrize("seed", SEEDS)
def test_bounds(seed):
    car = hidden_car(seed)
    check_monotone(car.servo.curve)
    assert 0.3 <= math.degrees(car.servo.backlash) <= 2.0
    assert abs(car.clock_error) <= 0.003
    assert abs(car.oscillator_hz / 25e6 - 1.01) <= 0.04
    assert abs(car.servo.curve.s0 - PAPER.steering.s0) <= 0.06
    assert abs(car.vehicle.body.mass / PAPER.body.mass - 1) <= 0.03
    assert max(map(abs, car.imu.gyro_bias)) <= math.radians(1.0)
    assert abs(car.gear_revolution / 0.0412918 - 1) <= 0.005
    assert sum(car.ring_a.fractions) == pytest.approx(20)
    curve = make_steering(car.servo.curve)
    assert 0.22 < curve(1.0) < 0.40
    assert -0.44 < curve(-1.0) < -0.27


@pytest.mark.slow
def test_no_car_looks_like_a_stuck_imu(raw_car):
    """Firmware takes 20 equal samples in motion for a dead sensor."""
    car = raw_car("sim://?nano=mock").arm().drive(0.3, 0.3, 8.0)
    samples = [(s["lin_acc"], s["gyro"]) for s in car.states()[-300:]]
    runs = [len(set(samples[k:k + 5])) for k in range(len(samples) - 5)]
    assert min(runs) >= 2


@pytest.mark.slow
def test_servo_comes_to_rest_where_its_friction_decides(raw_car):
    """Same pulse, same direction, other angle: a spread of about the stated sigma."""
    car = raw_car("sim://?nano=mock&seed=3")
    rests = []
    for _ in range(30):
        car.pulses(1200, 1500)
        car.run(0.4)
        car.pulses(1600, 1500)
        car.run(0.4)
        rests.append(car.world.servo.command * 375)
    mean = sum(rests) / 30
    spread = (sum((r - mean)**2 for r in rests) / 29)**0.5
    assert spread == pytest.approx(hidden_car(3).servo.repeatability, rel=0.5)


def test_cars_differ_and_repeat():
    cars = [hidden_car(s) for s in SEEDS]
    assert cars == [hidden_car(s) for s in SEEDS]
    assert len({c.servo.curve for c in cars}) == len(cars)
    assert len({c.ring_a for c in cars}) == len(cars)


def test_ring_option():
    assert hidden_car(5, "even").ring_a == hidden_car(0).ring_a
    assert hidden_car(5, "even").servo == hidden_car(5).servo
    assert hidden_car(0, "hidden").ring_a != hidden_car(0).ring_a
    assert hidden_car(5, "hidden") == hidden_car(5)


@pytest.mark.parametrize("seed", [0, 3])
def test_reveal_has_the_shape_of_the_contract(seed):
    shown = json.loads(json.dumps(reveal(seed), allow_nan=False))
    assert set(shown) >= {"seed", "vehicle", "steering", "sensors", "effects"}
    commands, angles = shown["steering"]["command"], shown["steering"]["angle_rad"]
    assert len(commands) == len(angles) >= 201
    assert (commands[0], commands[-1]) == (-1.0, 1.0)
    assert angles == sorted(angles)
    assert set(shown["sensors"]) == {
        q for q in QUANTITIES if not q.startswith(("mocap.", "lidar."))}
    revealed = reveal_url(Url.parse(f"sim://?seed={seed}&mocap=1&lidar=1"))
    assert set(revealed["sensors"]) == set(QUANTITIES)
    assert sum(shown["sensors"]["encoder.ring"]) == pytest.approx(20)


@pytest.mark.slow
def test_revealed_angle_is_the_middle_of_the_loop(raw_car):
    car = raw_car("sim://?nano=mock&seed=3")
    shown = reveal(3)
    at = {round(c, 6): a for c, a in zip(shown["steering"]["command"],
                                         shown["steering"]["angle_rad"], strict=True)}
    above, below = [], []
    for start, angles in 12 * [(1.0, above), (-1.0, below)]:
        car.pulses(1500 + 375 * start, 1500)
        car.run(0.5)
        car.pulses(1500 + 375 * 0.4, 1500)
        car.run(0.5)
        angles.append(car.truth.steering)
    # one count of the PWM; the servo rests within 1.5 us, 0.0013 rad/us, of its target
    assert statistics.mean(above + below) == pytest.approx(at[0.4], abs=0.004)
    width = statistics.mean(above) - statistics.mean(below)
    assert width == pytest.approx(shown["sensors"]["steering.backlash"], abs=0.0024)
    assert statistics.stdev(above) > 0.0


@pytest.mark.parametrize("seed", [0, 1, 42])
def test_car_file_parses_and_shows_no_secret(seed):
    backend = open_backend(f"sim://?nano=mock&seed={seed}")
    car = hidden_car(seed)
    config = parse_config(backend.car_toml, "sim")
    assert backend.car == config.name == f"sim-{seed}"
    assert (config.steering.center_us, config.steering.span_us) == (1500.0, 375.0)
    clock = config.pwm.oscillator_hz
    assert abs(clock.value - car.oscillator_hz) <= 3 * clock.std
    per_edge = config.encoder.metres_per_edge
    assert abs(per_edge.value - car.gear_revolution / 20) <= 2 * per_edge.std
    assert config.geometry.mass == PAPER.body.mass
    backend.close()
