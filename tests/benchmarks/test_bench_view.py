"""Twenty emulated cars in three programs, on the page of their fleet."""

from __future__ import annotations

import bench_view
import pytest


@pytest.mark.long
@pytest.mark.realtime
def test_twenty_cars_are_found_lost_and_stopped_in_time():
    found, red, stopped = bench_view.fleet()
    assert bench_view.CARS == 20
    assert found <= 5.0
    assert red <= 1.0
    assert stopped <= 0.3
