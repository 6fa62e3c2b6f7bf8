"""Held-out stretches lie between those that train, separate from them, and each is excited."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.recording.dart.spans import span_index
from dart_lab.diagnosis.motion import driving_seconds
from dart_lab.diagnosis.split import GUARD_S, MIN_STRETCH_S, hold_out, split
from dart_lab.identification.evidence.onboard_drive import prepare_stretches
from tests.diagnosis.onboard_files import make_recording, record_onboard

RECORDING_SECONDS = 120.0


@pytest.fixture
def one_sided():
    """A drive that steers to the left in its first half and to the right in its second."""
    n = int(RECORDING_SECONDS / 0.1)
    t = np.arange(n) * 0.1
    wave = np.sign(np.sin(2.0 * np.pi * t / 4.0))
    return make_recording(n, steering=0.3 * np.where(t < 0.5 * RECORDING_SECONDS, 1.0, -1.0)
                          + 0.2 * wave,
                          throttle=0.2 + 0.05 * np.sign(np.sin(2.0 * np.pi * t / 7.0)))


def gaps(train, test):
    """Times between the stretches of both sides in their order [s]."""
    every = sorted([*train.spans, *test.spans])
    return [b[0] - a[1] for a, b in itertools.pairwise(every)]


@pytest.mark.parametrize("share", [0.3, 0.4])
def test_stretches_alternate_with_a_guard_between_them(one_sided, share):
    train, test = split(one_sided, share)
    assert len(test.spans) >= 6
    assert min(gaps(train, test)) >= GUARD_S - 1e-9
    held = sum(b - a for a, b in test.spans)
    assert held == pytest.approx(share * RECORDING_SECONDS, rel=0.25)
    assert all(b - a >= MIN_STRETCH_S for a, b in (*train.spans, *test.spans))


def test_both_sides_steer_both_ways(one_sided):
    """The control is the last 40 % of the time: it steers to the right only."""
    t = one_sided.messages.arrival
    steering = one_sided.messages.steering
    means = [steering[span_index(r.spans, t) >= 0].mean() for r in split(one_sided, 0.4)]
    assert abs(means[0] - means[1]) < 0.1
    last = steering[t > 0.6 * RECORDING_SECONDS].mean()
    assert abs(steering[t < 0.6 * RECORDING_SECONDS].mean() - last) > 0.3


def test_every_stretch_has_steps_of_both_commands(one_sided):
    t = one_sided.messages.arrival
    for side in split(one_sided, 0.4):
        for begin, end in side.spans:
            rows = (t >= begin) & (t <= end)
            assert np.ptp(one_sided.messages.steering[rows]) > 0.3
            assert np.ptp(one_sided.messages.throttle[rows]) > 0.05


def test_a_rare_manoeuvre_is_on_both_sides():
    """Steering in 12 s of each minute alone: shifts of the cycle are chosen by what they hold."""
    t = np.arange(1200) * 0.1
    active = t % 30.0 < 18.0
    r = make_recording(len(t),
                       steering=np.where(active, 0.4 * np.sign(np.sin(2.0 * np.pi * t / 3.0)), 0.0))
    for side in split(r, 0.4):
        spread = [np.std(r.messages.steering[(t >= a) & (t <= b)]) for a, b in side.spans]
        assert sum(s > 0.1 for s in spread) >= 3


def test_short_recordings_test_at_their_beginning_and_end_by_turns():
    short = [make_recording(120) for _ in range(4)]
    _, test = hold_out(short, 0.4)
    assert [side.spans[0][0] < 1.0 for side in test] == [False, True, False, True]
    for train, tested in zip(*hold_out(short, 0.4), strict=True):
        assert min(gaps(train, tested)) >= GUARD_S - 1e-9


@pytest.mark.slow
def test_windows_of_the_sides_share_no_message(tmp_path):
    r = record_onboard(tmp_path, seconds=60.0)
    times = []
    for side in split(r, 0.4):
        spots = [s.window_starts[None, :] + np.concatenate([s.past_offsets, s.message_offsets])
                 for s in prepare_stretches(side)]
        times.append(np.concatenate([x.ravel() for x in spots]) * 0.01)
        assert len(times[-1]) > 100
    near = np.abs(times[0][:, None] - times[1][None, :]).min()
    assert near >= GUARD_S - 0.11  # a message is at most 0.1 s from where it should be
    assert driving_seconds(split(r, 0.4)[1]) < 0.45 * driving_seconds(r)


def test_without_spans_all_of_a_recording_is_judged(tmp_path):
    """The control of the test above."""
    r = record_onboard(tmp_path, seconds=30.0)
    whole = sum(len(s.starts) for s in prepare_stretches(r))
    begin = float(r.messages.arrival[0])
    half = sum(len(s.starts) for s in prepare_stretches(replace(r, spans=((begin, begin + 15.0),))))
    assert 0.3 * whole < half < 0.7 * whole
