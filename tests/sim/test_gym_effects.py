"""An extended model.toml drives in DartCar-v0, alone and in a vector."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.config import save_model
from dart_hal.vehicle import UPSTREAM_2024
from dart_hal.vehicle.effects import add_effects, parse_effects
from dart_hal.vehicle.file import model_of
from dart_lab.sim.gym import DartCarEnv, DartCarVectorEnv

EFFECTS = "gyro_bias:0.05,steering_backlash:0.05,encoder_scale:0.04,quadratic_drag:0.2"
ACTION = np.array([0.3, 0.2], dtype=np.float32)


@pytest.fixture
def model(tmp_path):
    p = add_effects(UPSTREAM_2024, parse_effects(EFFECTS))
    return save_model(model_of(p), tmp_path / "extended.toml")


def episode(env, steps=30, **options):
    observations = [env.reset(seed=5, options=options or None)[0]]
    return np.array(observations + [env.step(ACTION)[0] for _ in range(steps)])


def test_what_is_observed_has_the_errors_of_the_sensors():
    base, biased = (episode(DartCarEnv(vehicle=add_effects(UPSTREAM_2024, parse_effects(text))))
                    for text in ("", "gyro_bias:0.05,encoder_scale:0.04"))
    names = DartCarEnv().names
    rate, speed = names.index("yaw_rate"), names.index("speed")
    assert biased[1:, rate] - base[1:, rate] == pytest.approx(0.05, abs=2.1e-3)   # two digits
    assert biased[10:, speed] == pytest.approx(1.04 * base[10:, speed], abs=1e-3)


@pytest.mark.slow_except("False")
@pytest.mark.parametrize("randomise", [False, True])
def test_vector_and_single_see_the_same(model, randomise):
    single = episode(DartCarEnv(vehicle=model), randomise=randomise)
    env = DartCarVectorEnv(2, vehicle=model)
    observations = [env.reset(seed=5, options={"randomise": randomise})[0]]
    observations += [env.step(np.stack([ACTION, ACTION]))[0] for _ in range(30)]
    assert np.array(observations)[:, 0] == pytest.approx(single, abs=1e-5)
    assert np.abs(single - episode(DartCarEnv(), randomise=randomise)).max() > 0.04
