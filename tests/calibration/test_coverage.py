"""The coverage campaign: what it counts, and one car of it."""

from __future__ import annotations

import numpy as np
import pytest

from .coverage import EACH, POOLED, rows_of
from .hidden_errors import errors, worst

CARS = 400


def found(stated: float) -> list[dict[str, list[tuple[float, float]]]]:
    """Errors of 1 beside standard errors that are ``stated``; ring: 20 numbers a car."""
    rng = np.random.default_rng(3)
    return [{"bias": [(float(rng.normal()), stated)],
             "ring": [(float(e), 1.0) for e in rng.normal(size=20)]} for _ in range(CARS)]


def test_honest_intervals_are_honest():
    bias, ring, pooled = rows_of(found(1.0))
    assert all(EACH[0] < row.share < EACH[1] for row in (bias, ring))
    assert POOLED[0] < pooled.share < POOLED[1]
    assert pooled.share == pytest.approx(0.5 * (bias.share + ring.share))
    assert bias.rms == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_control_intervals_that_are_not_are_seen(stated):
    bias, ring, pooled = rows_of(found(stated))
    assert not EACH[0] < bias.share < EACH[1]
    assert EACH[0] < ring.share < EACH[1]
    assert not POOLED[0] < pooled.share < POOLED[1]


@pytest.mark.more
def test_every_number_of_one_hidden_car_is_near_the_truth():
    z = worst(errors("all", 12))
    assert len(z) >= 25
    assert {name: round(x, 1) for name, x in z.items() if x > 4.0} == {}
