"""Commands at the times of their writes, and velocities of a marker that turns."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.timing import SAMPLE
from dart_hal.recording.dart import AppliedCommands
from dart_hal.recording.dart.marker import savgol_derivative, turning_share

POINTS = 15


def test_a_sample_is_the_mean_of_what_was_held_in_it():
    commands = AppliedCommands(np.array([0.0, 0.0225]), np.array([0.0, 1.0]), np.array([0.4, 0.4]))
    throttle, steering = commands.sample_means(5)
    assert throttle == pytest.approx([0.0, 0.0, 0.75, 1.0, 1.0])
    assert steering.tolist() == [0.4] * 5


def test_before_the_first_write_its_command_counts():
    commands = AppliedCommands(np.array([0.02, 0.03]), np.array([0.5, 1.0]), np.array([0.0, 0.0]))
    assert commands.sample_means(4)[0] == pytest.approx([0.5, 0.5, 0.5, 1.0])


@pytest.mark.parametrize("rate", [0.5, 3.0, 8.0])
def test_the_velocity_of_a_circle_is_that_of_the_circle(rate):
    t = np.arange(200) * SAMPLE
    # 1 m/s
    x = np.sin(rate * t) / rate
    y = -np.cos(rate * t) / rate
    inner = slice(POINTS, -POINTS)
    speed = np.hypot(savgol_derivative(x, POINTS), savgol_derivative(y, POINTS))[inner]
    kept = turning_share(np.full(len(t), rate), POINTS)[inner]
    assert speed / kept == pytest.approx(1.0, abs=1e-9)
    assert abs(speed[0] - 1.0) == pytest.approx(5.57 * (rate * SAMPLE)**2, rel=0.1)  # without it
