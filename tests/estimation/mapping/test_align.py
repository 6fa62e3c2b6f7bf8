"""A map laid onto the truth: what was turned and moved is found, what was stretched is reported."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.mapping.align import align_points


def test_turn_shift_and_size_are_found():
    true = np.random.default_rng(1).uniform(-3.0, 3.0, (50, 2))
    c = np.cos(0.4)
    s = np.sin(0.4)
    points = (true - (1.0, -2.0)) @ np.array(((c, -s), (s, c)))
    found = align_points(points, true)
    assert (found.turn, found.size) == pytest.approx((0.4, 1.0))
    assert found.transform(points) == pytest.approx(true)
    assert align_points(0.99 * points, true).size == pytest.approx(1.0 / 0.99)
