"""The motion model of a track, and places at rest."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.types import MotionEstimate, Pose, Tracking
from dart_hal.estimation.other_cars.rectangle import RectangleFit
from dart_hal.estimation.other_cars.resting import MIN_REST_TIME, RestingPoints
from dart_hal.estimation.other_cars.tracks import start_track


def fit_at(track, off=(0.0, 0.0, 0.0), std=0.01, share=1.0):
    return RectangleFit(track.mean[:3] + off, np.eye(3) * std**2, 10, 10, share, False)


def test_prediction_is_that_of_the_own_motion():
    track = start_track(1, 0.0, np.array((1.0, 2.0)), np.array((0.6, 0.8)), 0.0875)
    track = track.update(fit_at(track))
    x, y, yaw, speed, rate = track.mean
    own = MotionEstimate(0.0, Pose(x, y, yaw), speed, rate, np.zeros((5, 5)), "room",
                         Tracking.TRACKING).predict(0.3)
    found = track.predict(0.3)
    assert found.mean == pytest.approx((own.pose.x, own.pose.y, own.pose.yaw, speed, rate))
    assert np.all(np.diag(found.cov) > np.diag(track.cov))
    assert track.predict(-1.0) is track


def test_speed_follows_the_places():
    """Places of a car at 1.0 m/s; the start took it for 0.7 m/s."""
    track = start_track(1, 0.0, np.array((0.0, 0.0)), np.array((0.7, 0.0)), 0.0)
    for k in range(1, 16):
        track = track.predict(0.12 * k)
        off = np.array((0.12 * k, 0.0, 0.0)) - track.mean[:3]
        track = track.update(fit_at(track, off))
    assert track.mean[3] == pytest.approx(1.0, abs=0.05)
    assert track.confirmed
    assert np.all(np.linalg.eigvalsh(track.cov) > 0.0)


def test_a_track_that_does_not_travel_is_not_confirmed():
    track = start_track(1, 0.0, np.array((0.0, 0.0)), np.array((0.3, 0.0)), 0.0)
    for k in range(1, 16):
        track = track.predict(0.12 * k)
        track = track.update(fit_at(track, -track.mean[:3]))
    assert not track.confirmed


def test_beams_through_it_end_a_track():
    track = start_track(1, 0.0, np.array((0.0, 0.0)), np.array((1.0, 0.0)), 0.0)
    assert not track.is_contradicted
    assert track.contradict(fit_at(track, share=0.0)).contradict(
        fit_at(track, share=0.0)).is_contradicted


def test_points_rest_after_seconds_and_are_forgotten():
    rest = RestingPoints()
    point = np.array(((1.0, 2.0),))
    for k in range(20):
        assert not rest.contains(point)[0]
        rest.add(point + 0.1 * k * np.array((0.0, 1.0)), 0.12 * k)  # it moves
    for k in range(20):
        rest.add(point, 3.0 + 0.12 * k)
    assert MIN_REST_TIME < 20 * 0.12
    assert rest.contains(point + 0.02)[0], "within the noise"
    assert not rest.contains(point + 0.3)[0]
    rest.add(np.empty((0, 2)), 30.0)
    assert not rest.contains(point)[0]
