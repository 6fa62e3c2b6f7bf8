"""The matcher: C and numpy agree, and a kernel that differs is not used."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation import matcher
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.rays import cast_numpy
from dart_hal.vehicle.native.build import compiler
from dart_lab.sim.lidar.maps import room_of


def scan_of(seed):
    """Map, points of a noisy scan with a tenth of them anywhere, and a start 3 cm and 1 deg aside.
    """
    room = room_of("room", seed)
    rng = np.random.default_rng(seed)
    turn = np.linspace(0.0, 2.0 * np.pi, 606, endpoint=False)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    x, y, _ = room.start
    reach = cast_numpy(room.lines, np.tile((x, y), (606, 1)), direction)
    reach = np.where(rng.uniform(size=606) < 0.1, rng.uniform(0.1, 12.0, 606), reach)
    points = (reach + 0.015 * rng.normal(size=606))[:, None] * direction
    return (map_of_lines(room.lines), points[reach < 20.0], points[reach < 20.0],
            np.array((x + 0.02, y - 0.02, 0.02, 0.004)), np.diag((2500.0, 2500.0, 1e4, 1e5)))


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
@pytest.mark.parametrize("small", [0.0, matcher.STEP_TOLERANCE])
def test_the_kernel_agrees_with_numpy(small):
    by_c = matcher.native_match()
    assert by_c is not None, "match.c does not compile, or differs"
    for seed in range(8):
        given = scan_of(seed)
        spread = np.linspace(1.0, 4.0, len(given[1]))
        want = matcher.match_numpy(*given, small, spread)
        got = by_c(*given, small, spread)
        assert got.pose == pytest.approx(want.pose, abs=1e-9)
        assert got.info == pytest.approx(want.info, rel=1e-6, abs=1e-3)
        assert np.hypot(*(want.pose[:2] - given[3][:2])) > 0.01


def test_a_kernel_that_disagrees_is_not_used():
    """The control is numpy itself."""
    def wrong(*given):
        found = matcher.match_numpy(*given)
        return matcher.Match(found.pose + 1e-6, found.info)

    assert matcher._is_equal(matcher.match_numpy)
    assert not matcher._is_equal(wrong)


def test_numpy_takes_over_where_it_is_switched_off(monkeypatch):
    monkeypatch.setenv("DART_HAL_NATIVE", "0")
    matcher.native_match.cache_clear()
    try:
        assert matcher.native_match() is None
        given = scan_of(3)
        assert matcher.match(*given).pose == pytest.approx(matcher.match_numpy(*given).pose)
    finally:
        monkeypatch.undo()
        matcher.native_match.cache_clear()
