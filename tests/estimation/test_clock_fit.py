"""The clock fit against the jitter of a USB link."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.clock_fit import ClockFit, find_middle_edge, lower_hull


def p99(values):
    return sorted(map(abs, values))[int(0.99 * len(values))]


@pytest.mark.parametrize("disturbed", [0.01, 0.05, 0.3])
@pytest.mark.parametrize("seed", [1, 2])
def test_host_time_of_a_sample_on_a_disturbed_link(clock_run, disturbed, seed):
    run = clock_run(disturbed, seed)
    assert p99(run.late) <= 0.3e-3
    assert max(map(abs, run.early)) <= 1e-3


def test_arrival_stamps_fail_the_same_bar(clock_run):
    run = clock_run(0.05, 1)
    assert p99(run.arrival) > 5e-3


def test_rate_is_known_to_3_ppm(clock_run):
    assert abs(clock_run(0.05, 3, warm_up=0.0).rate_error) <= 3e-6


def test_published_time_never_goes_back(clock_run):
    published = clock_run(0.3, 4, reset_at=30.0).published
    assert all(b > a for a, b in pairwise(published))


def test_stated_uncertainty_covers_the_error(clock_run):
    for seed in range(4):
        run = clock_run(0.05, seed, duration=30.0)
        inside = sum(abs(e) <= 2 * s for e, s in zip(run.late, run.stds, strict=True))
        assert inside >= 0.95 * len(run.late)
        assert max(run.stds) < 1e-3


def test_recovers_within_3_s_of_a_reset(clock_run):
    run = clock_run(0.05, 5, duration=40.0, reset_at=30.0)
    after = run.early[-650:]  # 3 s and more behind the reset
    assert max(map(abs, after)) <= 1e-3


def test_virtual_link_without_jitter_is_exact(clock_run):
    run = clock_run(0.0, 6, jitter=0.0, least=0.0, warm_up=0.0)
    assert max(map(abs, run.late)) < 1e-6
    assert max(run.stds) < 2e-6


def test_bytes_behind_a_frame_are_subtracted():
    together = ClockFit()
    alone = ClockFit()
    for k in range(400):
        t = 0.01 * k
        alone.add_frame(t, 1.0 + t, 0.0)
        together.add_frame(t, 1.0 + t + 22 * together.byte_time, 0.0, 22)
    assert together.to_host(4.0)[0] == pytest.approx(alone.to_host(4.0)[0], abs=1e-9)


def test_an_older_time_does_not_pass_the_newest():
    clock = ClockFit()
    for k in range(100):
        clock.add_frame(0.01 * k, 5.0 + 0.01 * k, 0.0)
    newest, _ = clock.to_host(1.0)
    older, _ = clock.to_host(0.9)
    assert older <= newest
    assert clock.to_host(1.0)[0] >= newest


pairs = st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 10**6)), min_size=2,
                 unique_by=lambda p: p[0]).map(sorted)


@given(pairs)
def test_hull_lies_under_every_pair_and_is_convex(points):
    hull = lower_hull(points)
    assert hull[0] == points[0]
    assert hull[-1] == points[-1]
    for (xa, ya), (xb, yb) in pairwise(hull):
        for x, y in points:
            if xa <= x <= xb:
                assert (y - ya) * (xb - xa) >= (yb - ya) * (x - xa)
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(hull)]
    assert slopes == sorted(slopes)
    (xa, _), (xb, _) = find_middle_edge(hull)
    assert xa <= 0.5 * (points[0][0] + points[-1][0]) <= xb


@pytest.mark.parametrize("gap", [19.0, 21.0, 300.0])
def test_a_silence_longer_than_the_window_restarts_the_fit(gap):
    """A suspended computer, Ctrl-Z: the board runs on, and all stored pairs are too old."""
    clock = ClockFit()
    for k in range(3000):
        t = 0.01 * k
        clock.add_frame(t, 50.0 + t + 0.001, 0.0)
    for k in range(3000):
        t = 30.0 + gap + 0.01 * k
        clock.add_frame(t, 50.0 + t + 0.001, 0.0)
        host, std = clock.to_host(t)
        assert abs(host - (50.0 + t)) < 3.0 * std + 0.002
