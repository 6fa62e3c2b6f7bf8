"""DartCar-v0, one car: gymnasium's own checker, determinism, rewards, ends, options."""

from __future__ import annotations

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from dart_hal.core.errors import BadCommand, ConfigError, UsageError
from dart_hal.vehicle import PAPER, UPSTREAM_2024
from dart_lab.sim.gym import ENV_ID, SPREAD, GymConfig
from dart_lab.sim.light import LightConfig

KINDS = {"path": {}, "speed": {"task": "speed"}, "paper": {"vehicle": "paper"},
         "randomised": {"randomise": {"body.mass": 0.1}}, "eight": {"track": "eight"},
         "picture": {"render_mode": "rgb_array"}, "seeing": {"beams": 6, "opponents": 2}}


def make(**options):
    return gymnasium.make(ENV_ID, **options).unwrapped


@pytest.mark.slow_except("path")
@pytest.mark.parametrize("options", KINDS.values(), ids=KINDS)
def test_gymnasium_has_no_warning(options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(**options))


@pytest.mark.slow
def test_it_can_be_made_without_an_import():
    code = ("import gymnasium; e = gymnasium.make('dart_lab.sim.gym:DartCar-v0'); "
            "print(e.reset(seed=1)[0].shape)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "(17,)"


def test_without_gymnasium_it_names_what_to_install():
    code = ("import sys; sys.modules['gymnasium'] = None\n"
            "from dart_hal.core.errors import UsageError\n"
            "try:\n    import dart_lab.sim.gym\nexcept UsageError as e:\n    print(e.remedy)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "gymnasium>=" in done.stdout


def follow(env, observation):
    """Pure pursuit on the observation, about as the example has learnt it."""
    s = dict(zip(env.names, observation.tolist(), strict=True))
    if "x_0.6" not in s:
        return np.array([0.3 + 0.4 * s["error"], 0.0], np.float32)
    bend = 2.0 * s["y_0.6"] / (s["x_0.6"]**2 + s["y_0.6"]**2)
    return np.array([0.29 + 0.4 * (s["reference_speed"] - s["speed"]), 0.7 * bend], np.float32)


def episode(env, policy, seed=0, options=None):
    """(rewards, terminated, truncated, observations, last info)."""
    observation, _ = env.reset(seed=seed, options=options)
    rewards, observations = [], [observation]
    while True:
        observation, reward, terminated, truncated, info = env.step(policy(env, observation))
        rewards.append(reward)
        observations.append(observation)
        if terminated or truncated:
            return rewards, terminated, truncated, np.array(observations), info


@pytest.mark.parametrize("options", [{}, {"task": "speed"}, {"vehicle": "paper", "speed": 1.0}],
                         ids=["path", "speed", "paper"])
@pytest.mark.slow_except("path")
def test_a_good_driver_gets_nearly_one_per_step_and_is_cut_at_the_end(options):
    env = make(**options)
    rewards, terminated, truncated, observation, _ = episode(env, follow)
    assert (terminated, truncated, len(rewards)) == (False, True, 400)
    assert np.mean(rewards) > (0.5 if "vehicle" in options else 0.75)
    assert max(rewards) <= 1.0
    measured = [i for i, name in enumerate(env.names) if name not in ("throttle", "steering")]
    assert (np.abs(observation) < env.observation_space.high)[:,
                                                              measured].all(), "nothing was clipped"


def test_who_leaves_the_track_is_reported_so():
    rewards, terminated, truncated, _, info = episode(make(), lambda e, o: np.array([0.4, 0.0]))
    assert (terminated, truncated) == (True, False)
    assert rewards[-1] == -10.0
    assert abs(info["offset"]) > 0.3
    assert len(rewards) < 200


def test_at_rest_pays_nothing():
    rewards, *_, info = episode(make(), lambda e, o: follow(e, o) * [0.0, 1.0])
    assert len(rewards) == 400, "it rolls out on the track"
    assert np.mean(rewards[100:]) == pytest.approx(-(info["offset"] / 0.3) ** 2, abs=0.05)


@pytest.mark.parametrize("task", ["path", "speed"])
def test_a_change_of_the_commands_costs(task):
    """Two equal cars until the last command, which no lagging actuator has followed yet."""
    rewards = []
    for last in (0.0, 1.0):
        env = make(task=task, period=0.01)
        env.reset(seed=4)
        env.step(np.array([0.2, 0.0], np.float32))
        rewards.append(env.step(np.array([0.2, last], np.float32))[1])
    assert rewards[0] - rewards[1] == pytest.approx(0.05, abs=0.005)


@pytest.mark.slow
def test_same_seed_same_bytes():
    runs = [episode(make(), follow, seed)[3].tobytes() for seed in (3, 3, 4)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_the_observation_is_what_the_page_states():
    env = make(light=LightConfig())
    observation, info = env.reset(seed=2)
    for _ in range(40):
        action = follow(env, observation)
        observation, _, _, _, info = env.step(action)
    s = dict(zip(env.names, observation.tolist(), strict=True))
    state = env.car.state
    assert s["speed"] == pytest.approx(state[3], abs=1e-5)
    assert s["yaw_rate"] == pytest.approx(state[5], abs=1e-5)
    assert (s["throttle"], s["steering"]) == pytest.approx(tuple(np.clip(action, -1, 1)))
    assert s["offset"] == pytest.approx(info["offset"], abs=1e-5)
    assert s["heading"] == pytest.approx(info["heading"], abs=1e-5)
    assert 0.15 < np.hypot(s["x_0.2"], s["y_0.2"]) < 0.55
    assert s["x_1.2"] > s["x_0.2"], "ahead is ahead"


def test_a_point_to_the_left_is_positive():
    """On the circle to the left every point ahead lies to the left, on the eight later right."""
    env = make(track="circle", light=LightConfig())
    observation, _ = env.reset(seed=0)
    assert dict(zip(env.names, observation.tolist(), strict=True))["y_1.2"] > 0.2


def masses(env, n=40, options=None):
    env.reset(seed=0, options=options)
    got = [env.car.vehicle.body.mass]
    for _ in range(n):
        env.reset()
        got.append(env.car.vehicle.body.mass)
    return np.array(got)


def test_the_car_is_drawn_within_the_bounds_at_each_reset():
    env = make()
    assert set(masses(env, 3)) == {UPSTREAM_2024.body.mass}
    drawn = masses(env, options={"randomise": {"body.mass": 0.1}}) / UPSTREAM_2024.body.mass - 1
    assert len(set(drawn)) == 41
    assert np.abs(drawn).max() <= 0.1
    assert np.ptp(drawn) > 0.15
    assert set(masses(env, 3, {"randomise": False})) == {UPSTREAM_2024.body.mass}


def test_the_standard_spread_fits_both_kinds_of_tyres():
    for name in ("paper", "upstream-2024"):
        env = make(vehicle=name)
        env.reset(seed=1, options={"randomise": True})
        a, b = env.car.vehicle.tyres, (PAPER if name == "paper" else UPSTREAM_2024).tyres
        assert a.front_D != b.front_D
        assert abs(a.front_D / b.front_D - 1.0) <= SPREAD["tyres.front_D"]


def test_the_picture_shows_the_car_where_it_is():
    env = make(render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(20):
        env.step(np.array([0.4, 0.0], np.float32))
    second = env.render()
    assert first.shape == second.shape
    assert first.dtype == np.uint8
    changed = np.argwhere((first != second).any(axis=2))
    assert 20 < len(changed) < 0.05 * first.shape[0] * first.shape[1]
    assert make().render() is None


@pytest.mark.slow
def test_with_gymnasiums_own_wrappers_nothing_is_warned_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(ENV_ID, render_mode="rgb_array")
        env.reset(seed=1)
        for _ in range(50):
            env.step(env.action_space.sample())
            env.render()


def test_an_action_that_is_no_number_is_refused():
    env = make()
    env.reset(seed=0)
    with pytest.raises(BadCommand):
        env.step(np.array([np.nan, 0.0], np.float32))


def test_refusals():
    env = make()
    for bad in (lambda: make(task="drift"), lambda: make(colour="red"), lambda: make(track="ovel"),
                lambda: make(light=LightConfig(sensors=None)), lambda: make(vehicle="papre"),
                lambda: make(randomise={"body.l_f": 0.1}), lambda: make(randomise={"mass": 0.1}),
                lambda: make(randomise={"body.mass": "a"}), lambda: make(randomise="all"),
                lambda: make(speed="fast"), lambda: make(period=None), lambda: make(beams=3.5),
                lambda: make(opponents=float("inf")),
                lambda: env.reset(options={"rain": 1}),
                lambda: env.reset(options={"randomise": {"body.mass": 1.5}})):
        with pytest.raises(UsageError):
            bad()
    with pytest.raises(ConfigError):
        GymConfig(period=0.033)
    with pytest.raises(ConfigError):
        make(vehicle="paper", randomise={"tyres.front_C": 0.99})
