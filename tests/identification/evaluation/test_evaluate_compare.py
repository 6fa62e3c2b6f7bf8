"""Intervals of a gain: right where blocks are independent, and honest about few of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_lab.identification.evaluation import gain, gains
from dart_lab.identification.evaluation.compare import MIN_BLOCKS, label_blocks


def test_an_exact_gain_has_an_interval_of_no_width():
    first = np.random.default_rng(1).normal(size=300)
    found = gain(first, -0.7 * first, np.repeat(np.arange(10), 30))
    assert found.value == pytest.approx(0.3, abs=1e-12)
    assert (found.low, found.high) == pytest.approx((0.3, 0.3), abs=1e-12)
    assert found.certain
    assert gain(first, first, np.repeat(np.arange(10), 30)).certain is False


def correlated(rng, blocks_: int, size: int):
    """Errors whose size is drawn once per block, for each of two models."""
    scale = np.exp(0.6 * rng.normal(size=(2, blocks_)))
    noise = rng.normal(size=(2, blocks_, size))
    return (scale[:, :, None] * noise).reshape(2, -1)


@pytest.mark.slow
def test_interval_covers_the_truth_and_one_over_windows_does_not():
    rng = np.random.default_rng(3)
    of_blocks = of_windows = 0
    for k in range(80):
        first, other = correlated(rng, 20, 8)
        block = np.repeat(np.arange(20), 8)
        found = gain(first, other, block, seed=k)
        naive = gain(first, other, np.arange(len(first)), seed=k)
        of_blocks += found.low < 0.0 < found.high
        of_windows += naive.low < 0.0 < naive.high
    assert of_blocks > 0.85 * 80
    assert of_windows < 0.75 * 80, "the control: overlapping windows are no sample"


def test_too_few_blocks_give_no_interval():
    e = np.random.default_rng(1).normal(size=(2, 60))
    found = gain(*e, np.repeat(np.arange(MIN_BLOCKS - 1), 20))
    assert np.isfinite(found.value)
    assert np.isnan(found.low)
    assert not found.certain


@pytest.mark.parametrize("blocks", [4, 6, 12])
def test_an_interval_of_few_blocks_covers_the_truth(blocks):
    """A minute of driving has six blocks. A bootstrap of so few misses the truth in a fifth."""
    rng = np.random.default_rng(blocks)
    missed = bootstrapped = 0
    draws = 400
    for _ in range(draws):
        level = rng.normal(0.0, 0.4, blocks)
        first, other = np.exp(level + rng.normal(0.0, 0.15, (2, blocks)))
        found = gain(first, other, np.arange(blocks))
        missed += found.certain
        counts = rng.multinomial(blocks, np.full(blocks, 1 / blocks), 400)
        ratio = np.quantile((counts @ other**2) / (counts @ first**2), (0.025, 0.975))
        bootstrapped += not ratio[0] < 1.0 < ratio[1]
    assert missed <= 0.1 * draws
    assert bootstrapped > 0.1 * draws or blocks == 12, "the control"


def test_the_same_seed_gives_the_same_interval():
    e = correlated(np.random.default_rng(5), 12, 10)
    block = np.repeat(np.arange(12), 10)
    assert gain(*e, block, seed=4) == gain(*e, block, seed=4)
    assert gain(*e, block, seed=4) != gain(*e, block, seed=5)


def test_blocks_never_reach_across_recordings(driven):
    cases = [driven(file=str(k), seconds=27.0) for k in range(3)]
    block, unit = label_blocks(cases)
    owner = np.repeat(np.arange(3), [len(c) for c in cases])
    for label in np.unique(block):
        assert len(set(owner[block == label])) == 1
    assert len(np.unique(block)) == 9
    assert unit == "stretches of 10 s"
    many = [replace(cases[0], file=str(k)) for k in range(8)]
    by, unit = label_blocks(many)
    assert unit == "recordings"
    assert np.array_equal(np.unique(by), np.arange(8))


def test_models_on_different_windows_are_not_compared(driven):
    e = np.ones((3, 5, 4))
    with pytest.raises(UsageError):
        gains(e, e[:, :, 1:], [driven()])


def test_gains_by_channel(driven):
    cases = [driven(seconds=50.0)]
    rng = np.random.default_rng(1)
    first = rng.normal(size=(3, 5, len(cases[0])))
    other = first * np.array([1.0, 0.5, 2.0, 0.9, 1.0])[None, :, None]
    found = gains(first, other, cases, horizon=2.0)
    assert [g.value for g in found.values()] == pytest.approx([0.0, 0.5, -1.0, 0.1, 0.0])
