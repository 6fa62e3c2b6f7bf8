"""The standard error of a mean by batches: do 1.645 of it hold 90 %?"""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.fitting.batches import NORMAL_90, standard_error

DRAWS = 20_000
CHANCE = 0.006
"""Three standard errors of a share of 90 % of that many draws."""


def share_within(means, std):
    return float(np.mean(np.abs(means.mean(axis=0)) < NORMAL_90 * std))


@pytest.mark.parametrize("n", [3, 5, 10, 40])
def test_its_interval_holds_nine_tenths(n):
    means = np.random.default_rng(n).normal(size=(n, DRAWS))
    assert share_within(means, standard_error(means)) == pytest.approx(0.9, abs=CHANCE)


def test_control_the_plain_scatter_holds_less():
    means = np.random.default_rng(1).normal(size=(10, DRAWS))
    plain = np.std(means, axis=0, ddof=1) / np.sqrt(10)
    assert share_within(means, plain) < 0.9 - 4.0 * CHANCE
