"""Features of windows and messages: what a drive that is known exactly must give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dart_hal.recording.dart import Grid, Messages, Recording, Reference
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.steering import make_steering
from dart_lab.diagnosis.unexplained.features import FEATURE_UNITS, message_features, window_features
from dart_lab.identification.evidence.drive import RecordedDrive
from dart_lab.identification.evidence.residuals import Evidence

MEAN_SPEED = 0.8
RADIUS = 2.0
ROWS_OF_FEATURES = 2000


def circle(side: float = 1.0, steering: float = 0.4) -> RecordedDrive:
    """A steady circle about the origin; side 1 is to the left."""
    t = np.arange(ROWS_OF_FEATURES) * 0.01
    turn = side * MEAN_SPEED / RADIUS * t
    one = np.ones(ROWS_OF_FEATURES)
    grid = Grid(t, RADIUS * np.sin(np.abs(turn)), side * RADIUS * (1 - np.cos(turn)), turn,
                MEAN_SPEED * one, 0 * one, side * MEAN_SPEED / RADIUS * one, 0.25 * one,
                side * steering * one, MEAN_SPEED * one, np.zeros(ROWS_OF_FEATURES, bool),
                Reference(0, 0, 0, "exact"))
    m = np.arange(1.0, 19.0, 0.1)
    nothing = np.full(len(m), np.nan)
    messages = Messages(m, m, np.zeros(len(m), int), 0 * m, 0 * m, 0 * m, m > 0, nothing, nothing,
                        nothing, nothing)
    recording = Recording(Path("circle.csv"), "B", messages, None, "ok", None, "", ())
    at = 100.0 * m
    return RecordedDrive(recording, grid, np.arange(100, 1800, 50), at, np.zeros((len(at), 4)),
                 np.zeros(len(at), bool), np.ones(2))


@pytest.mark.parametrize("features", [window_features, message_features])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_circle_is_described_as_what_it_is(features, side):
    drive = circle(side)
    found = features(Evidence([drive], PAPER.body.l_r), PAPER)
    assert list(found) == list(FEATURE_UNITS)
    angle = side * float(make_steering(PAPER.steering, np)(np.array(0.4)))
    expected = {"speed": MEAN_SPEED, "yaw_rate": side * MEAN_SPEED / RADIUS, "steering_rate": 0.0,
                "acceleration": 0.0, "lateral_acceleration": side * MEAN_SPEED**2 / RADIUS,
                "throttle": 0.25, "direction": side}
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, atol=1e-9, err_msg=name)
    if side > 0:
        np.testing.assert_allclose(found["steering_angle"], angle, atol=1e-9)
    assert np.sign(found["steering_angle"]).tolist() == [side] * len(found["speed"])
    assert (np.abs(found["heading"]) <= np.pi).all()
    assert ((found["revolution_angle"] >= 0) & (found["revolution_angle"] < 1)).all()


def test_rows_are_those_of_the_residuals_drive_by_drive():
    left = circle(1.0)
    right = circle(-1.0)
    evidence = Evidence([left, right], PAPER.body.l_r)
    windows, messages = (f(evidence, PAPER) for f in (window_features, message_features))
    residuals = evidence.residuals(PAPER)
    assert {len(v) for v in windows.values()} == {len(residuals.motion)}
    assert {len(v) for v in messages.values()} == {len(residuals.sensors)}
    np.testing.assert_array_equal(windows["direction"], np.where(evidence.motion_drive, -1.0, 1.0))
    np.testing.assert_array_equal(messages["direction"],
                                  np.where(evidence.sensor_drive, -1.0, 1.0))


def test_a_shorter_span_sees_only_the_beginning():
    drive = circle()
    long, short = (window_features(Evidence([drive], PAPER.body.l_r), PAPER, span)
                   for span in (100, 10))
    np.testing.assert_allclose(long["time"] - short["time"], 0.45, atol=1e-9)


def test_without_any_drive_there_is_nothing():
    assert all(len(v) == 0 for v in window_features(Evidence([], 0.09), PAPER).values())
