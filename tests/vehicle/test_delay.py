"""Delays of series, of ticks and of events are the same delay."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle.delay import DelayQueue, DelayRing, delay_series
from dart_lab.identification.prediction.actuators import delay_command

RAMP = np.concatenate([np.zeros(5), np.arange(20.0)])


@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.013, 0.029999999999, 0.05])
def test_a_ring_gives_what_a_series_gives(seconds):
    ring = DelayRing(seconds, SAMPLE)
    assert [ring.step(v) for v in RAMP] == delay_series(RAMP, seconds, SAMPLE).tolist()


def test_a_tuple_is_delayed_part_by_part():
    ring = DelayRing(0.015, SAMPLE)
    there_and_back = (RAMP, -RAMP)
    ticks = [ring.step(pair) for pair in zip(*there_and_back, strict=True)]
    assert np.array_equal(np.transpose(ticks), delay_series(there_and_back, 0.015, SAMPLE))


@pytest.mark.parametrize(("seconds", "samples"), [(0.02, 2), (0.014, 1), (0.016, 2), (-0.03, -3),
                                                  (9.0, 24), (-9.0, -24)])
def test_a_command_is_delayed_by_whole_samples_and_its_ends_are_held(seconds, samples):
    at = np.clip(np.arange(len(RAMP)) - samples, 0, len(RAMP) - 1)
    assert np.array_equal(delay_command(RAMP, seconds), RAMP[at])


def test_an_event_is_handed_out_once_when_its_time_has_come():
    queue = DelayQueue[str]()
    queue.put(0.1, "first")
    queue.put(0.2, "second")
    assert list(queue.take(0.05)) == []
    assert list(queue.take(0.15)) == ["first"]
    assert list(queue.take(0.2)) == ["second"]
    assert list(queue.take(9.0)) == []
