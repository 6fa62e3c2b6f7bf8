"""What of a recording without motion capture becomes windows, and what is taken for standstill."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.timing import SAMPLE
from dart_lab.diagnosis.policy import USUAL
from dart_lab.identification.evidence.onboard import NOT_OBSERVABLE, list_limits
from dart_lab.identification.evidence.onboard_drive import (
    ENCODER_MEAN_S,
    MESSAGES_AHEAD,
    STATE_MESSAGES,
    count_windows,
    prepare_stretches,
)
from tests.diagnosis.onboard_files import evidence, make_recording

BEFORE = (STATE_MESSAGES + 2) * ENCODER_MEAN_S
SETTLE_ROWS = MESSAGES_AHEAD * ENCODER_MEAN_S


def starts(drives):
    """Time of every start in its recording [s]."""
    return np.concatenate([d.grid.t[d.starts] for d in drives])


def test_windows_follow_each_other_and_predict_every_message_twice():
    times = starts(prepare_stretches(make_recording(120)))
    assert np.diff(times) == pytest.approx(0.5)
    assert times.min() == pytest.approx(BEFORE)
    assert times.max() == pytest.approx(11.9 - SETTLE_ROWS)


def test_nothing_reaches_across_a_gap():
    t = np.arange(120) * 0.1
    t[60:] += 2.0
    drives = prepare_stretches(make_recording(t=t))
    assert len(drives) == 2
    for d, (low, high) in zip(drives, ((0.0, 5.9), (8.0, 13.9)), strict=True):
        times = d.grid.t[d.starts]
        assert len(times)
        assert times.min() >= low + BEFORE - SAMPLE
        assert times.max() + SETTLE_ROWS <= high + SAMPLE
        assert (d.window_starts + d.message_offsets.max(axis=0)).max() * SAMPLE <= 5.9 + 1e-9


def test_a_lost_message_costs_the_windows_around_it_and_no_others():
    whole = make_recording(120).messages.t
    lost = np.delete(whole, 60)
    kept = starts(prepare_stretches(make_recording(t=lost)))
    assert not np.any((kept > 6.0 - SETTLE_ROWS - SAMPLE) & (kept < 6.0 + ENCODER_MEAN_S))
    assert np.any(kept < 6.0 - SETTLE_ROWS - SAMPLE)
    assert np.any(kept > 6.1)
    assert len(prepare_stretches(make_recording(t=lost))) == 1


@pytest.mark.parametrize(("columns", "why"), [
    ({"speed": 0.1}, "too slow"), ({"throttle": -0.3}, "perhaps backwards"),
    ({"speed": np.nan}, "no encoder"), ({"yaw_rate": np.nan}, "no gyro")])
def test_no_window_starts_where_the_sensors_do_not_measure_the_motion(columns, why):
    assert sum(len(d.starts) for d in prepare_stretches(make_recording(**columns))) == 0, why
    assert sum(len(d.starts) for d in prepare_stretches(make_recording())) > 0


def test_rest_is_rest_before_and_after_and_not_being_carried():
    speed = np.where(np.arange(120) < 60, 0.0, 1.0)
    rate = np.where((np.arange(120) >= 10) & (np.arange(120) < 20), 0.9, 0.002)
    drive, = prepare_stretches(make_recording(speed=speed, yaw_rate=rate, throttle=0.0))
    at = drive.message_samples[drive.at_rest]
    assert len(at) == 58 - 10
    assert at.max() == pytest.approx(580.0)
    assert not np.any((at > 95.0) & (at < 195.0))


def test_rounded_readings_at_rest_have_the_noise_of_their_rounding_and_no_bias():
    rng = np.random.default_rng(0)
    step = 0.01
    rate = np.round(rng.normal(0.0, 1e-4, 200) / step) * step  # all of them 0 ...
    rate[3] = step  # ... but one, which shows the step
    drive, = prepare_stretches(make_recording(200, speed=0.0, yaw_rate=rate, throttle=0.0))
    readings = drive.readings[drive.at_rest, 1]
    assert abs(readings.mean()) < 0.02 * step
    assert readings.std() == pytest.approx(step / np.sqrt(12.0), rel=0.1)


def test_standstill_counts_by_how_much_quieter_it_is_and_no_more_than_floors_are_level():
    rng = np.random.default_rng(1)
    shaken = np.where(np.arange(400) < 200, 0.2, 2.0) * rng.normal(size=400)
    speed = np.where(np.arange(400) < 200, 0.0, 1.0)
    drive, = prepare_stretches(make_recording(400, speed=speed, accel_x=shaken, accel_y=0.0))
    assert drive.noise_scale[0] == pytest.approx(10.0, rel=0.3)
    assert drive.noise_scale[1] == 1.0
    quiet, = prepare_stretches(make_recording(400, speed=speed,
                                              accel_x=np.where(speed > 0.0, shaken, 0.0)))
    assert quiet.noise_scale[0] == pytest.approx(2.0 / USUAL.evidence.min_level_std, rel=0.3)


def test_what_cannot_be_known_is_reported():
    rolling = evidence(make_recording())
    assert list_limits(rolling)[:len(NOT_OBSERVABLE)] == NOT_OBSERVABLE
    assert any("at rest for 2 s" in s for s in list_limits(rolling))
    stopped = evidence(make_recording(speed=np.where(np.arange(120) < 60, 0.0, 1.0)))
    assert list_limits(stopped) == NOT_OBSERVABLE
    assert any("no accelerometer" in s
               for s in list_limits(evidence(make_recording(accel_x=np.nan))))
    windows, driving, rest = count_windows(stopped.drives)
    assert windows > 5
    assert driving == 5 * windows
    assert rest == 58
