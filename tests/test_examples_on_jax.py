"""The examples on JAX: a fit that agrees with `dart-hal identify`, and a policy that learns."""

from __future__ import annotations

import runpy

import jax
import pytest

from tests.test_examples import EXAMPLES


@pytest.fixture
def main(request):
    yield runpy.run_path(str(EXAMPLES / "jax" / f"{request.param}.py"))["main"]
    jax.config.update("jax_enable_x64", False)


@pytest.mark.slow
@pytest.mark.parametrize("main", ["fit_by_gradients"], indirect=True)
def test_a_fit_by_gradients_agrees_with_identify(main):
    differences = main(EXAMPLES.parent / "tests" / "recorded" / "data" / "81_throttle_ramps")
    assert len(differences) == 6
    assert max(differences.values()) < 0.3


@pytest.mark.parametrize("main", ["learn_by_ppo"], indirect=True)
@pytest.mark.long
def test_a_few_updates_drive_further_in_the_lane(main):
    pursuit, before, after = main(20)
    assert pursuit[0] > 0.9, "control: the lane can be kept"
    assert after[0] > before[0] + 0.2
