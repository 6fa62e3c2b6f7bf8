"""One light car: delays to the moment, lags, servo, standstill, reverse, determinism."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import BadCommand, ConfigError, UsageError
from dart_hal.vehicle import PAPER, SETS, UPSTREAM_2024, Delay, make_car_step
from dart_hal.vehicle.file import model_of
from dart_lab.sim.light import (
    DART_ACTUATORS,
    FIRMWARE,
    Actuators,
    Disturbance,
    LightCar,
    LightConfig,
)
from dart_lab.sim.light.chain import make_slew, split_step
from dart_lab.sim.light.ops import SCALAR_OPS
from dart_lab.sim.light.stepper import find_substeps

BARE = LightConfig(sensors=None)


def test_a_step_is_the_step_of_the_equations():
    car, step = LightCar(UPSTREAM_2024, BARE), make_car_step(UPSTREAM_2024, math, 0.01)
    car.reset(v_x=1.5)
    state = car.state
    for k in range(100):
        command = 0.3, math.sin(0.1 * k)
        state = step(*state, *command)
        assert car.advance(*command) == state


@pytest.mark.parametrize("throttle", [0.0, 0.01, 0.013, 0.02, 0.1])
@pytest.mark.parametrize("steering", [0.0, 0.004, 0.013, 0.025, 0.15])
def test_pieces_fill_the_step_and_carry_the_delay(throttle, steering):
    """A command given in step 0 acts for one step's length in all, ``delay`` later."""
    parts = split_step(0.01, throttle, steering)
    assert len(parts) <= 3
    assert sum(p.duration for p in parts) == pytest.approx(0.01, abs=1e-12)
    for name, delay in (("throttle", throttle), ("steering", steering)):
        acts = [(getattr(p, name), p.duration) for p in parts]
        assert sum(d for _, d in acts) == pytest.approx(0.01)
        assert sum(k * d for k, d in acts) / 0.01 * 0.01 == pytest.approx(delay, abs=1e-9)


def late(steering_s, throttle_s, step):
    """Pose 0.6 s after a swerve, with delays [s] and a step [s]; commands change each 50 ms."""
    p = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=steering_s,
                                             throttle_s=throttle_s))
    car = LightCar(p, replace(BARE, step=step))
    car.reset(v_x=2.0, throttle=0.3)
    for k in range(12):
        car.advance(0.3 + 0.2 * (k % 2), 0.8 if k % 4 < 2 else -0.8, round(0.05 / step))
    return np.array(car.state[:6])


@pytest.mark.slow
def test_a_delay_inside_a_step_is_exact():
    truth = late(0.0253, 0.0137, 0.0001)
    ours = np.abs(late(0.0253, 0.0137, 0.01) - truth).max()
    rounded = np.abs(late(0.03, 0.01, 0.01) - truth).max()
    assert ours < 2e-3
    assert rounded > 10 * ours, "the control: rounding delays to steps is far off"


def test_nothing_moves_before_the_delay_is_over():
    car = LightCar(replace(PAPER, delay=Delay(steering_s=0.15)), BARE)
    car.advance(0.0, 1.0, 15)
    assert car.state[7] == 0.0
    car.advance(0.0, 1.0)
    assert car.state[7] == pytest.approx(1.0)


def test_a_lag_is_exponential_for_any_step():
    for step in (0.005, 0.01, 0.02):
        car = LightCar(UPSTREAM_2024, replace(BARE, step=step))
        car.advance(0.4, -0.5, round(0.2 / step))
        lag = UPSTREAM_2024.delay
        assert car.state[6] == pytest.approx(0.4 * (1 - math.exp(-0.2 / lag.throttle_lag_s)))
        assert car.state[7] == pytest.approx(-0.5 * (1 - math.exp(-0.2 / lag.steering_lag_s)))


def test_the_servo_turns_no_faster_than_its_rate():
    car = LightCar(PAPER, replace(BARE, actuators=Actuators(steering_rate=4.0)))
    car.advance(0.0, 1.0, 30)              # 0.15 s of delay, then 0.15 s of turning
    assert car.state[7] == pytest.approx(0.6, abs=0.021)
    car.advance(0.0, 1.0, 30)
    assert car.state[7] == pytest.approx(1.0)


@pytest.mark.parametrize("target", [-1.0, 0.01, 0.3, 0.5])
def test_the_mean_of_a_ramp_is_that_of_the_ramp(target):
    slew, n = make_slew(10.0, SCALAR_OPS), 20_000
    end, mean = slew(0.25, target, 0.01)
    fine, total = 0.25, 0.0
    for _ in range(n):
        new, _ = slew(fine, target, 0.01 / n)
        total += 0.5 * (fine + new) / n
        fine = new
    assert (end, mean) == (pytest.approx(fine), pytest.approx(total, abs=1e-6))


def test_dead_band_and_quanta():
    car = LightCar(replace(UPSTREAM_2024, delay=Delay()), replace(BARE, actuators=DART_ACTUATORS))
    for throttle in np.linspace(-1.2, 1.2, 97):
        car.advance(float(throttle), 0.0)
        acting = car.state[6] / DART_ACTUATORS.throttle_quantum
        assert acting == pytest.approx(round(acting))
        if abs(throttle) < 0.05:
            assert acting == 0.0
        elif 0.07 < abs(throttle) < 1.0:
            assert car.state[6] == pytest.approx(throttle, abs=0.0055)


@pytest.mark.parametrize("p", SETS.values(), ids=SETS)
def test_a_car_at_rest_with_turned_wheels_stays(p):
    car = LightCar(p, BARE)
    car.advance(0.0, 1.0, 200)
    assert max(map(abs, car.state[:6])) < 1e-12


@pytest.mark.parametrize("p", SETS.values(), ids=SETS)
def test_in_reverse_it_turns_the_other_way_and_stays_sane(p):
    car = LightCar(p, BARE)
    car.advance(-0.35, 0.5, 300)
    assert -3.0 < car.state[3] < -0.3
    assert car.state[5] < -0.3, "wheels to the left, backwards: the nose goes right"
    car.advance(0.35, 0.5, 300)
    assert car.state[3] > 0.3
    assert car.state[5] > 0.3


@pytest.mark.parametrize("p", SETS.values(), ids=SETS)
def test_slow_cars_are_integrated_finely_enough(p):
    """Rolling to a stop in a turn; the control takes whole steps and trembles."""
    fine, car = make_car_step(p, math, 0.0002), LightCar(p, BARE)
    coarse = make_car_step(p, math, 0.01)
    start = (0.0, 0.0, 0.0, 0.3, 0.15, -3.0, 0.0, 0.7)
    car.reset(*start)
    a = b = start
    worst = [0.0, 0.0]
    for k in range(40):
        car.advance(0.0, 0.7)
        for _ in range(50):
            a = fine(*a, 0.0, 0.7)
        b = coarse(*b, 0.0, 0.7)
        if k > 5:
            worst = [max(w, abs(s[5] - a[5])) for w, s in zip(worst, (car.state, b), strict=True)]
    assert worst[0] < 0.02
    if p is not UPSTREAM_2024:             # whose regularisation keeps it soft
        assert worst[1] > 10 * worst[0]


def test_fineness_follows_from_the_vehicle():
    assert find_substeps(PAPER, 0.01).parts > 1
    assert find_substeps(PAPER, 0.001).parts == 1
    assert find_substeps(replace(PAPER, kind="kinematic"), 0.01).parts == 1
    stiff = replace(PAPER, body=replace(PAPER.body, yaw_inertia=PAPER.body.yaw_inertia / 4))
    assert find_substeps(stiff, 0.01).parts > find_substeps(PAPER, 0.01).parts


def drive(seed, config=None):
    rough = LightConfig(sensors=FIRMWARE, actuators=DART_ACTUATORS,
                        disturbance=Disturbance(0.12, 0.12))
    car = LightCar(UPSTREAM_2024, config or rough, seed)
    return np.array([car.drive(0.4, math.sin(0.05 * k)) for k in range(200)]).tobytes()


def test_same_seed_same_bytes():
    assert drive(3) == drive(3)
    assert drive(3) != drive(4)


def test_reset_with_a_seed_is_a_new_car():
    config = LightConfig(sensors=FIRMWARE, disturbance=Disturbance(0.1, 0.1))
    car = LightCar(config=config, seed=5)
    first = [car.drive(0.3, 0.1) for _ in range(50)]
    car.reset()
    assert [car.drive(0.3, 0.1) for _ in range(50)] != first, "noise goes on"
    car.reset(seed=5)
    fresh = LightCar(config=config, seed=5)
    fresh.reset(seed=5)
    assert [car.drive(0.3, 0.1) for _ in range(50)] == [fresh.drive(0.3, 0.1) for _ in range(50)]


def test_halving_the_step_changes_little():
    ends = []
    for step in (0.01, 0.005):
        car = LightCar(UPSTREAM_2024, replace(BARE, step=step))
        car.reset(v_x=1.0)
        for k in range(100):
            car.advance(0.4, math.sin(0.1 * k), round(0.02 / step))
        ends.append(np.array(car.state))
    assert np.abs(ends[0] - ends[1]).max() < 1e-3


def test_a_model_file_is_a_vehicle(tmp_path):
    from dart_hal.core.config import save_model

    path = tmp_path / "model.toml"
    save_model(model_of(PAPER), path)
    assert LightCar(path).vehicle == PAPER
    assert LightCar("paper").vehicle == PAPER


@pytest.mark.parametrize("command", [(math.nan, 0.0), (0.0, math.inf)])
def test_a_command_that_is_no_number_is_refused(command):
    with pytest.raises(BadCommand):
        LightCar().advance(*command)


def test_refusals():
    with pytest.raises(UsageError, match="no model"):
        LightCar("papre")
    with pytest.raises(UsageError, match="no sensors"):
        LightCar(config=BARE).read()
    with pytest.raises(ConfigError):
        LightConfig(step=1.0)
    with pytest.raises(ConfigError):
        Disturbance(along=-1.0)
    with pytest.raises(ConfigError):
        Actuators(dead_band=math.nan)


@pytest.mark.slow
@pytest.mark.parametrize("statement", ["import dart_hal", "import dart_lab.sim",
                                       "import dart_lab.sim.light",
                                       "from dart_lab.sim.light import LightBatch"])
def test_no_learning_library_is_loaded(statement):
    code = f"{statement}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"gymnasium", "matplotlib", "scipy", "torch"} & set(done.stdout.split())
