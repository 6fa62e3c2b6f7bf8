"""The ring table: positions, learning from EDGES frames, missing marks."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.estimation import Ring, RingLearner

tables = st.lists(st.floats(0.3, 3.0), min_size=2, max_size=24)


@given(tables, st.integers(-1000, 1000))
def test_positions_add_up(fractions, edge):
    ring = Ring(0.002, len(fractions), fractions)
    assert ring.position(edge + 1) - ring.position(edge) == pytest.approx(ring.gap(edge))
    assert ring.position(edge + ring.n) - ring.position(edge) == pytest.approx(0.002 * ring.n)
    middle = ring.position(edge) + 0.5 * ring.gap(edge)
    assert ring.edge_at(middle) == edge


def test_a_table_of_another_ring_is_refused():
    with pytest.raises(ValueError, match="10 for 20"):
        Ring(0.002, 20, [1.0] * 10)


def uneven(n, seed=3):
    rng = random.Random(seed)
    raw = [1 + rng.gauss(0, 0.03) + (0.12 if i % 2 else -0.12) for i in range(n)]
    return np.array(raw) * n / sum(raw)


def edges_frames(fractions, turns, *, first=0, rate=500.0, growth=0.0, lost=0.0, seed=4):
    """EDGES frames of ``turns`` revolutions: (first_count, intervals in ck)."""
    rng = random.Random(seed)
    n = len(fractions)
    frames = []
    for frame in range(turns * n // 8):
        start = first + 8 * frame
        intervals = [round(2e6 * fractions[(start + k) % n]
                           / (rate * (1 + growth * (8 * frame + k) / (turns * n))))
                     for k in range(8)]
        if rng.random() >= lost:
            frames.append((start + 1, intervals))
    return frames


def learner_of(frames):
    learner = RingLearner()
    for first, intervals in frames:
        learner.add(first, intervals)
    return learner


@pytest.mark.parametrize("n", [8, 10, 18, 20])
@pytest.mark.parametrize("first", [0, 7])
def test_learns_the_table_at_the_counted_marks(n, first):
    truth = uneven(n)
    learnt = learner_of(edges_frames(truth, 24, first=first)).learn(n)
    assert learnt.fractions.sum() == pytest.approx(n)
    assert np.abs(learnt.fractions - truth).max() < 2e-3
    assert learnt.revolutions >= 20


def test_a_steady_acceleration_cancels():
    truth = uneven(20)
    learnt = learner_of(edges_frames(truth, 24, growth=0.3)).learn(20)
    assert np.abs(learnt.fractions - truth).max() < 3e-3


def test_an_acceleration_shifts_no_mark_of_an_uneven_ring():
    """Exact times of marks at v = v0 exp(-x / 60 turns); 1.3e-4 off where middles are equal."""
    truth = uneven(20)
    n = 20
    places = np.concatenate([[0.0], np.cumsum(np.tile(truth, 30))]) / n
    learner = RingLearner()
    learner.add(1, (1e6 * np.diff(60.0 * np.exp(places / 60.0))).tolist())
    assert np.abs(learner.learn(n).fractions - truth).max() < 5e-6


def test_lost_frames_only_cost_revolutions():
    truth = uneven(10)
    learnt = learner_of(edges_frames(truth, 200, lost=0.3)).learn(10)
    assert np.abs(learnt.fractions - truth).max() < 3e-3


def test_standard_error_is_honest():
    truth = uneven(10)
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(40):
        frames = [(f, [round(i * (1 + 0.01 * rng.standard_normal())) for i in ck])
                  for f, ck in edges_frames(truth, 24)]
        learnt = learner_of(frames).learn(10)
        scores.append(((learnt.fractions - truth) / learnt.std) ** 2)
    assert 0.6 < np.mean(scores) < 1.6


def test_a_missing_mark_is_an_interval_of_three():
    truth = [1.0] * 17 + [3.0]
    truth = [f * 18 / 20 for f in truth]
    learner = learner_of(edges_frames(truth, 40, rate=450.0))
    assert learner.period(range(4, 41, 2)) == 18
    learnt = learner.learn(18)
    others = np.delete(learnt.fractions, 17)
    assert learnt.fractions[17] == pytest.approx(3 * others.mean(), rel=0.01)


def test_saturated_intervals_split_a_run():
    learner = RingLearner()
    learner.add(1, [1000, 1000, 65535, 1000, 1000, 1000, 1000, 1000])
    assert learner.intervals == 7
    with pytest.raises(ValueError, match="too few"):
        learner.learn(10)


def test_too_little_data_is_reported():
    with pytest.raises(ValueError, match="too few"):
        RingLearner().learn(20)
