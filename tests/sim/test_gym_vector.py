"""DartCar-v0, many cars: each environment as it would be alone, in gymnasium's own words."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import dart_lab.sim.gym
from dart_hal.core.errors import BadCommand, UsageError
from dart_lab.sim.gym import ENV_ID, DartCarVectorEnv
from dart_lab.sim.light import RECORDED, Disturbance, LightConfig

OLD = LightConfig(sensors=RECORDED, disturbance=Disturbance(0.05, 0.05, 0.0))
KINDS = {
    "path": {}, "speed": {"task": "speed", "episode": 2.0}, "paper": {"vehicle": "paper"},
    "short": {"episode": 1.0, "half_width": 0.15}, "recorded": {"light": OLD, "half_width": 0.15},
    "randomised": {"randomise": {"body.mass": 0.1, "tyres.front_D": 0.2}, "half_width": 0.12},
    "seeing": {"beams": 6, "opponents": 8, "episode": 2.0},
}


def make(n, mode="vector_entry_point", **options):
    return gymnasium.make_vec(ENV_ID, num_envs=n, vectorization_mode=mode, **options)


def actions(n, k):
    a = np.random.default_rng([9, k]).uniform(-1.0, 1.0, (n, 2))
    a[:, 0] = 0.3 + 0.15 * a[:, 0]
    return a.astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_together_as_alone(options):
    """150 steps compared with gymnasium's own SyncVectorEnv, across many resets."""
    n = 5
    ours, theirs = make(n, **options), make(n, "sync", **options)
    a, b = ours.reset(seed=5), theirs.reset(seed=5)
    np.testing.assert_allclose(a[0], b[0], atol=1e-6)
    ends = 0
    for k in range(150):
        a, b = ours.step(actions(n, k)), theirs.step(actions(n, k))
        for ours_is, theirs_is in zip(a[:4], b[:4], strict=True):
            np.testing.assert_allclose(ours_is, theirs_is, atol=1e-6)
        assert set(a[4]) == set(b[4])
        for key in a[4]:
            np.testing.assert_allclose(a[4][key], b[4][key], atol=1e-9)
        ends += int((a[2] | a[3]).sum())
    assert ends > 2, "no reset would prove little"


@pytest.mark.slow
def test_a_second_reset_without_a_seed_goes_on_equally():
    ours, theirs = make(3), make(3, "sync")
    for seed in (1, None, None, 7):
        a, b = ours.reset(seed=seed), theirs.reset(seed=seed)
        np.testing.assert_allclose(a[0], b[0], atol=1e-6)
        for k in range(10):
            a, b = ours.step(actions(3, k)), theirs.step(actions(3, k))
            np.testing.assert_allclose(a[0], b[0], atol=1e-6)


@pytest.mark.slow
def test_options_reach_all_environments():
    ours, theirs = make(3), make(3, "sync")
    a, b = (v.reset(seed=2, options={"randomise": True}) for v in (ours, theirs))
    for k in range(60):
        a, b = ours.step(actions(3, k)), theirs.step(actions(3, k))
    np.testing.assert_allclose(a[0], b[0], atol=1e-6)
    assert np.ptp(ours.cars.vehicle.body.mass) > 0.0


def test_the_step_after_the_end_resets():
    env = make(4, episode=0.5, half_width=5.0)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    for k in range(10):
        observation, _, _, truncated, info = env.step(actions(4, k))
    assert truncated.all()
    assert (info["t"] == 0.5).all()
    observation, reward, terminated, truncated, info = env.step(actions(4, 11))
    assert not (terminated | truncated).any()
    assert (reward == 0.0).all()
    assert (info["t"] == 0.0).all()
    assert "offset" not in info
    names = list(env.names)
    assert (observation[:, [names.index("throttle"), names.index("steering")]] == 0.0).all()


@pytest.mark.slow
def test_more_environments_change_none():
    few, many = make(2), make(40)
    few.reset(seed=3)
    many.reset(seed=3)
    for k in range(80):
        a = actions(40, k)
        x, y = few.step(a[:2]), many.step(a)
    np.testing.assert_allclose(x[0], y[0][:2], atol=1e-6)


@pytest.mark.slow
def test_same_seed_same_bytes():
    def run(seed):
        env = make(6)
        out = [env.reset(seed=seed)[0]]
        out += [env.step(actions(6, k))[0] for k in range(50)]
        return np.array(out).tobytes()

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_spaces_and_default_mode():
    env = gymnasium.make_vec("dart_lab.sim.gym:DartCar-v0", num_envs=7)
    assert isinstance(env, DartCarVectorEnv)
    observation, _ = env.reset(seed=[10 + i for i in range(7)])
    assert env.observation_space.contains(observation)
    assert env.single_observation_space.shape == observation.shape[1:]
    assert env.action_space.shape == (7, 2)
    again, _ = env.reset(seed=10)
    np.testing.assert_array_equal(observation, again)
    with pytest.raises(UsageError):
        env.reset(seed=[1, 2])


@pytest.mark.slow
def test_one_picture_with_all_cars():
    env = make(3, render_mode="rgb_array")
    env.reset(seed=0)
    (picture,) = env.render()
    assert picture.shape[2] == 3
    colours, counts = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    of_cars = counts[(colours == dart_lab.sim.gym.render.CAR_COLOUR).all(axis=1)]
    (alone,) = (lambda e: (e.reset(seed=0), e.render())[1])(make(1, render_mode="rgb_array"))
    assert of_cars[0] > 2 * (alone == dart_lab.sim.gym.render.CAR_COLOUR).all(axis=2).sum()


def test_the_randomised_cars_of_a_vector_differ_and_stay_in_bounds():
    env = make(200, randomise={"body.mass": 0.1})
    env.reset(seed=0)
    masses = np.asarray(env.cars.vehicle.body.mass) / 1.58 - 1.0
    assert np.abs(masses).max() <= 0.1
    assert abs(masses.mean()) < 0.02
    assert masses.std() == pytest.approx(0.1 / np.sqrt(3), rel=0.15)


@pytest.mark.parametrize("wrong", [np.full((3, 2), np.nan), np.zeros((3, 1)), np.zeros((3, 3)),
                                   np.zeros((2, 2)), np.zeros(2)])
def test_a_refused_action_leaves_no_trace(wrong):
    """Neither the car nor the cost of the next change of commands knows of it."""
    tried, other = make(3), make(3)
    for env in (tried, other):
        env.reset(seed=4)
        env.step(actions(3, 0))
    with pytest.raises(BadCommand):
        tried.step(wrong)
    for a, b in zip(tried.step(actions(3, 1))[:4], other.step(actions(3, 1))[:4], strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf")])
def test_time_must_pass(period):
    with pytest.raises(UsageError, match="period"):
        make(2, period=period)
