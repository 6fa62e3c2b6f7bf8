"""The light simulation on JAX drives and reads as that of floats, and is differentiable."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dart_hal.vehicle import PAPER, UPSTREAM_2024
from dart_hal.vehicle.batch import car_rollout
from dart_hal.vehicle.effect import EFFECT_STAGES, PureDelay
from dart_hal.vehicle.effects import add_effects, catalogue, parse_effects
from dart_hal.vehicle.flat import make_setter, value
from dart_lab.sim.jax import Light, rollout
from dart_lab.sim.light import (
    DART_ACTUATORS,
    RECORDED,
    Encoder,
    Inertial,
    LightCar,
    LightConfig,
    Mocap,
    Sensors,
)
from dart_lab.sim.light.effects import COMMAND_CHANNELS

STEPS = 200
# Ages that are no whole number of steps, samples that are held, a rate limit and rounded commands.
ROUGH = LightConfig(sensors=Sensors(Encoder(0.02, window=0.05, metres_per_count=0.002),
                                    Inertial(0.03, quantum=1e-3), Inertial(0.01, age=0.013),
                                    Mocap(0.03, age=0.025)), actuators=DART_ACTUATORS)
COUNTED = LightConfig(sensors=Sensors(RECORDED.encoder, Inertial(0.1, quantum=1e-3)))
AS_DEFAULT = LightConfig()


@pytest.fixture
def doubles():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


def command(k):
    return 0.3 + 0.15 * (k % 50 > 25), 0.6 if k % 70 > 35 else -0.4


def drive(car):
    """States and readings (steps, 16)."""
    rows = []
    for k in range(STEPS):
        reading = car.drive(*command(k))
        rows.append([*car.state, *reading])
    return np.array(rows)


def drive_both(p, config):
    """States and readings (steps, 16) of both simulations, from standstill."""
    car = LightCar(p, config)
    first = car.read()
    light = Light(p, config)
    s, also_first = jax.jit(lambda: light.read(light.start(jax.random.key(0), jnp.zeros(8))))()
    assert np.allclose(first, also_first)
    advance = jax.jit(lambda s, tau, steering: light.read(light.advance(s, tau, steering), 1))
    found = []
    for k in range(STEPS):
        s, reading = advance(s, *command(k))
        found.append(jnp.stack([*s.state, *reading]))
    return drive(car), np.array(found)


def delays_a_command(effect):
    return any(isinstance(effect.signals.get(channel), PureDelay) for channel in COMMAND_CHANNELS)


@pytest.mark.slow
@pytest.mark.parametrize("stage", EFFECT_STAGES)
def test_every_effect_drives_and_reads_as_with_floats(doubles, stage):
    """All of a stage at once. The delay of a command is a parameter of the vehicle."""
    effects = [f"{name}:{of.parameters[0].sizes[0]}" for name, of in catalogue().items()
               if of.stage == stage and not delays_a_command(of)]
    p = add_effects(UPSTREAM_2024, parse_effects(",".join(effects)))
    ages = Sensors(Encoder(age=0.05), Inertial(age=0.05), Inertial(age=0.05), Mocap(age=0.05))
    expected, found = drive_both(p, LightConfig(sensors=ages))
    plain = drive(LightCar(UPSTREAM_2024, LightConfig(sensors=ages)))
    assert np.abs(expected - plain).max() > 1e-3, "control: they act"
    assert np.abs(found - expected).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("config", [ROUGH, COUNTED], ids=["rough", "counted"])
@pytest.mark.parametrize("p", [PAPER, UPSTREAM_2024], ids=["paper", "2024"])
@pytest.mark.long_except("paper-rough", "2024-counted")
def test_actuators_and_sensors_are_those_of_floats(doubles, p, config):
    expected, found = drive_both(p, config)
    assert np.abs(found - expected).max() < 1e-12


@pytest.mark.slow
def test_single_precision_is_within_1e_5(doubles):
    expected, _ = drive_both(UPSTREAM_2024, AS_DEFAULT)
    jax.config.update("jax_enable_x64", False)
    _, found = drive_both(UPSTREAM_2024, AS_DEFAULT)
    assert found.dtype == np.float32
    assert np.abs(found[:, :8] - expected[:, :8]).max() < 1e-5


@pytest.mark.slow
def test_a_rollout_is_that_of_numpy_for_one_car_and_for_many(doubles):
    rng = np.random.default_rng(1)
    start = np.zeros((8, 3))
    start[3] = 0.0, 0.5, 2.0
    throttle, steering = 0.3 + 0.1 * rng.standard_normal((2, STEPS, 3))
    expected = car_rollout(PAPER, start, throttle, steering, engine="numpy")
    found = rollout(PAPER, start, jnp.asarray(throttle), jnp.asarray(steering))
    assert np.abs(found - expected).max() < 1e-12


@pytest.mark.slow
def test_gradients_are_central_differences(doubles):
    """Of the last position and yaw, in each parameter of the fit and in the throttle."""
    names = ["friction.a", "friction.c", "motor.d", "motor.e", "steering.k_left", "tyres.front_D",
             "tyres.rear_B", "body.yaw_inertia", "delay.steering_lag_s"]
    vehicle = make_setter(UPSTREAM_2024, names)
    usual = jnp.array([value(UPSTREAM_2024, name) for name in names])
    throttle = jnp.asarray([command(k)[0] for k in range(STEPS)])
    steering = jnp.asarray([command(k)[1] for k in range(STEPS)])

    @jax.jit
    def end(numbers):
        moved = throttle + numbers[-1]
        return rollout(vehicle(numbers[:-1]), jnp.zeros(8).at[3].set(1.0), moved, steering)[-1, :3]

    at = jnp.append(usual, 0.0)
    slopes = jax.jit(jax.jacrev(end))(at)
    assert slopes.shape == (3, len(names) + 1)
    for i in range(len(at)):
        h = 1e-5 * max(abs(float(at[i])), 0.1)
        step = jnp.zeros(len(at)).at[i].set(h)
        difference = (end(at + step) - end(at - step)) / (2.0 * h)
        assert np.abs(difference).max() > 1e-6, "control: it acts"
        assert np.asarray(slopes[:, i]) == pytest.approx(np.asarray(difference), rel=1e-4, abs=1e-7)
