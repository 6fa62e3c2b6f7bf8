"""The growth of the lidar's noise with distance is measured from scans, and weighs the beams."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.localisation import matcher
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.range_noise import RangeNoise
from dart_hal.estimation.localisation.rays import cast_numpy
from dart_lab.sim.lidar.maps import box


def draw_scan(rng, constant, share):
    """Distances in a hall of 11 x 7 m from near one corner, 3 % of them without an echo."""
    turn = np.linspace(0.0, 2.0 * np.pi, 606, endpoint=False)
    direction = np.column_stack((np.cos(turn), np.sin(turn)))
    r = cast_numpy(box(5.5, 3.5, 0.0, 11.0, 7.0), np.tile((2.5, 2.0), (606, 1)), direction)
    noisy = r + rng.normal(size=606) * (constant + share * r)
    noisy[rng.uniform(size=606) < 0.03] = np.nan
    return noisy, direction


@pytest.mark.parametrize(("constant", "share"), [(0.01, 0.01), (0.008, 0.007), (0.015, 0.0)])
def test_share_is_measured(constant, share):
    """The control is a constant noise, which has none."""
    rng = np.random.default_rng(3)
    noise = RangeNoise()
    for _ in range(20):
        noise.add(draw_scan(rng, constant, share)[0])
    assert noise.share == pytest.approx(share, rel=0.2)
    assert (noise.spread(np.array((0.5, 8.0))) > 1.0).all() == (share > 0.0)


def test_scan_with_few_echoes_is_ignored():
    noise = RangeNoise()
    noise.add(np.full(606, np.nan))
    assert noise.share == 0.0


def test_weights_make_the_pose_better_where_noise_grows():
    """The control is the match without weights."""
    rng = np.random.default_rng(5)
    chart = map_of_lines(box(5.5, 3.5, 0.0, 11.0, 7.0))
    noise = RangeNoise()
    errors = []
    for _ in range(60):
        r, direction = draw_scan(rng, 0.01, 0.01)
        noise.add(r)
        valid = np.isfinite(r)
        points = r[valid, None] * direction[valid]
        start = np.array((2.52, 1.98, 0.01, 0.0))
        prior = np.diag((100.0, 100.0, 100.0, 1e6))
        found = [matcher.match(chart, points, points, start, prior, spread=spread).pose
                 for spread in (noise.spread(r[valid]), None)]
        errors.append([np.hypot(*(pose[:2] - (2.5, 2.0))) for pose in found])
    weighted, equal = np.sqrt(np.mean(np.square(errors), axis=0))
    assert weighted < 0.9 * equal


def test_one_scan_of_equal_distances_does_not_end_the_measurement():
    rng = np.random.default_rng(3)
    noise = RangeNoise()
    noise.add(np.full(606, 2.0))
    for _ in range(20):
        noise.add(draw_scan(rng, 0.01, 0.01)[0])
    assert noise.share == pytest.approx(0.01, rel=0.2)
