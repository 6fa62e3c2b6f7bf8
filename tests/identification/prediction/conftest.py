"""A recording of a car that never moved."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.recording.dart import Grid, Reference


@pytest.fixture
def empty():
    """``empty(n)`` -> a grid of nothing but zeros: 0.01 s, at rest."""
    def make(n: int) -> Grid:
        zero = np.zeros(n)
        return Grid(0.01 * np.arange(n), zero, zero, zero, zero, zero, zero, zero, zero, zero,
                    np.zeros(n, dtype=bool), Reference(0.09, 0.0, 0.0, "made up"))
    return make
