"""DartCar on JAX: observations, rewards and ends are those of gymnasium's DartCar-v0."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dart_lab.sim.gym import SPREAD, DartCarEnv, GymConfig
from dart_lab.sim.jax import DartCar
from dart_lab.sim.light import DART_ACTUATORS, Encoder, LightConfig, Sensors

NOISELESS = LightConfig(sensors=Sensors(Encoder(0.01, age=0.01)), actuators=DART_ACTUATORS)
PERIODS = 40


@pytest.fixture
def doubles():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


def same_start(usual, env):
    """Begin both at the place where gymnasium's begins."""
    first, _ = usual.reset(seed=3)

    @jax.jit
    def begin(start, memory):
        _, state = env.reset(jax.random.key(0))
        light = env._light(state.factors)
        car, reading = light.read(light.start(jax.random.key(1), start))
        return env._observe(state._replace(car=car, memory=memory), reading)

    return first, *begin(jnp.array(usual.car.state), jax.tree.map(jnp.asarray, usual._memory))


@pytest.mark.slow
@pytest.mark.parametrize("changes", [
    {}, {"beams": 12, "opponents": 2, "range_noise": 0.0}, {"task": "speed"}],
    ids=["path", "lidar", "speed"])
@pytest.mark.long_except("path")
def test_an_episode_is_that_of_gymnasium(doubles, changes):
    config = GymConfig(light=NOISELESS, **changes)
    usual = DartCarEnv(config)
    env = DartCar(config)
    assert env.names == usual.names
    first, observation, state = same_start(usual, env)
    assert np.asarray(observation) == pytest.approx(first, abs=1e-6)
    step = jax.jit(env.step)
    for k in range(PERIODS):
        action = np.array([0.3, 0.5 if k > 20 else -0.1])
        observed, reward, terminated, truncated, info = usual.step(action)
        out = step(state, jnp.asarray(action))
        state = out.state
        assert np.asarray(out.observation) == pytest.approx(observed, abs=1e-6)
        assert float(out.reward) == pytest.approx(reward, abs=1e-9)
        assert (bool(out.terminated), bool(out.truncated)) == (terminated, truncated)
        for name in set(out.info) & set(info):
            assert float(out.info[name]) == pytest.approx(info[name], abs=1e-9)


@pytest.mark.long
def test_many_drawn_cars_drive_and_begin_again():
    env = DartCar(randomise=True, episode=0.5)
    keys = jax.random.split(jax.random.key(2), 64)
    reset = jax.jit(jax.vmap(env.reset))
    _, state = reset(keys)
    assert state.factors.shape == (64, len(env.spread))
    assert set(env.spread) <= set(SPREAD)
    assert np.all(np.std(state.factors, axis=0) > 0.01)
    step = jax.jit(jax.vmap(env.step_or_reset))
    again = []
    for _ in range(12):
        out = step(state, jnp.full((64, 2), 0.2))
        assert np.isfinite(out.observation).all()
        again.append(int(out.state.k[0]))
        state = out.state
    assert 0 in again, "an episode of 10 steps has ended"
    assert max(again) < 10
    assert not np.array_equal(reset(keys)[0][0], reset(keys)[0][1]), "a start of its own"
    assert np.array_equal(reset(keys)[0], reset(keys)[0]), "that of its key"


@pytest.mark.long
def test_the_reward_is_differentiable_in_the_action(doubles):
    env = DartCar(light=LightConfig(sensors=Sensors()))
    _, state = jax.jit(env.reset)(jax.random.key(5))

    @jax.jit
    def reward(action):
        return env.step(state, action).reward

    slope = jax.jit(jax.grad(reward))(jnp.array([0.3, 0.1]))
    for i in range(2):
        step = jnp.zeros(2).at[i].set(1e-5)
        at = jnp.array([0.3, 0.1])
        difference = (reward(at + step) - reward(at - step)) / 2e-5
        assert abs(float(difference)) > 1e-6, "control: it acts"
        assert float(slope[i]) == pytest.approx(float(difference), rel=1e-4)
