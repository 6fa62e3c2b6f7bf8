"""Parameters that leave their stated errors together are wrong, though each stays within its own.

A delay and a lag of one command are known far better together than each.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.core.config.model import Covariance
from dart_lab.diagnosis.parameters.claims import _exceeds_stated_error, release_prior
from dart_lab.diagnosis.parameters.sets import GroupFits
from dart_lab.diagnosis.policy import USUAL

TIMING_PARAMETERS = ("delay.steering_s", "delay.steering_lag_s")
TIMING_STD = 0.03


def exceeds(changes, correlation=None, known=TIMING_PARAMETERS):
    """Judge changes in standard errors; correlation: stated in the file, None: not stated."""
    groups = object.__new__(GroupFits)
    cross = 0.0 if correlation is None else correlation * TIMING_STD**2
    groups._joint = None if correlation is None else Covariance(
        ("motor.d", *TIMING_PARAMETERS),
        ((4.0, 0.0, 0.0), (0.0, TIMING_STD**2, cross), (0.0, cross, TIMING_STD**2)))
    groups._names = {"steering timing": TIMING_PARAMETERS}
    groups.known = dict.fromkeys(known, TIMING_STD)
    groups.policy = USUAL
    groups.full = SimpleNamespace(x=np.array(changes),
                                  space=SimpleNamespace(names=TIMING_PARAMETERS))
    return _exceeds_stated_error(groups, frozenset({"steering timing"}))


@pytest.mark.parametrize("changes", [(1.9, 1.0), (-1.9, -1.0), (1.0, 1.0)])
def test_a_common_change_is_beyond_a_covariance_but_not_beyond_single_errors(changes):
    assert exceeds(changes, -0.97)
    assert not exceeds(changes), "control: without the covariance each is within its error"


@pytest.mark.parametrize("changes", [(1.5, -1.5), (0.2, 0.1), (0.0, 0.0)])
def test_a_change_within_the_covariance_is_none(changes):
    assert not exceeds(changes, -0.97)


def test_a_single_change_beyond_its_error_counts_with_any_covariance():
    assert exceeds((USUAL.claims.max_stated_stds + 0.1, 0.0))
    assert exceeds((0.0, 0.0), known=()), "a parameter without a stated error has no range"


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, -0.6, -0.97])
def test_a_right_model_leaves_the_ellipsoid_as_rarely_as_the_single_error(correlation):
    """Drawn from the stated covariance, at most 5 % leave the ellipsoid and 5 % each error."""
    rng = np.random.default_rng(3)
    drawn = rng.multivariate_normal((0.0, 0.0), [[1.0, correlation], [correlation, 1.0]], 2000)
    assert np.mean([exceeds(x, correlation) for x in drawn]) < 0.12


@pytest.mark.parametrize("truth", [0.0, 4.0, 8.0])
def test_error_of_a_changed_parameter_holds_its_truth_although_the_prior_draws_it_back(truth):
    """One parameter is measured with an error of 0.8 of the one that the file states."""
    data_std = 0.8
    normal = np.array([[data_std**-2 + 1.0]])
    space = SimpleNamespace(prior_weight=np.ones(1))
    rng = np.random.default_rng(5)
    drawn = 0
    held = 0
    trials = 500
    for measured in truth + data_std * rng.standard_normal(trials):
        fitted = measured * data_std**-2 / normal[0, 0]
        point = SimpleNamespace(x=np.array([fitted]), normal=normal, space=space)
        (released,), ((variance,),) = release_prior(point, np.linalg.inv(normal), (0,),
                                                    USUAL.prior.max_stated_stds)
        drawn += abs(fitted - truth) > 1.645 * normal[0, 0]**-0.5
        held += abs(fitted - truth) <= 1.645 * np.hypot(variance**0.5, released - fitted)
    assert held / trials >= 0.88
    assert truth == 0.0 or drawn / trials > 0.5, "control: the sampling error alone misses it"
