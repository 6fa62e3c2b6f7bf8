"""What sensors show of a motion, and that no other module computes it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import find_effect
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.parameters import GEAR_REVOLUTION
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.prediction.sensors import (
    add_drive_force,
    marker_pose,
    motion,
    read_sensors,
)

HOST = Path(__file__).resolve().parents[3] / "host"
T = 0.01 * np.arange(50)
SPEED, RATE = 1.5, 0.8
CIRCLE = np.stack([SPEED / RATE * np.sin(RATE * T), SPEED / RATE * (1 - np.cos(RATE * T)),
                   RATE * T, np.full(50, SPEED), np.zeros(50), np.full(50, RATE)])


def carrying(name, *values):
    return replace(PAPER, effects=(ActiveEffect(find_effect(name), values),))


def test_on_a_circle_the_accelerometer_measures_v_omega_and_the_gear_turns():
    now = motion(T, CIRCLE)
    wheel, gyro, a_x, a_y = read_sensors(PAPER, now)
    assert (wheel[7], gyro[7], a_x[7]) == (SPEED, RATE, 0.0)
    assert a_y == pytest.approx(SPEED * RATE)
    assert now.turns[-1] == pytest.approx(SPEED * 0.5 / GEAR_REVOLUTION)


def test_the_force_at_the_wheels_is_motor_and_friction():
    now = add_drive_force(PAPER, motion(T, CIRCLE), np.full(50, 0.3))
    expected = make_motor(PAPER.motor)(0.3, SPEED) + make_friction(PAPER.friction)(SPEED)
    assert now.drive == pytest.approx(expected)


def test_effects_change_what_they_name():
    now = motion(T, CIRCLE)
    assert read_sensors(carrying("gyro_scale", 0.1), now)[1] == pytest.approx(1.1 * RATE)
    marker = tuple(CIRCLE[:3])
    for ours, expected in zip(marker, marker_pose(PAPER, T, CIRCLE, marker), strict=True):
        assert expected is ours
    late = marker_pose(carrying("mocap_latency", 0.02), T, CIRCLE, marker)
    assert late[2][10:] == pytest.approx(CIRCLE[2][8:-2])


def found(pattern: str) -> set[str]:
    """Files of the package in which a line matches."""
    return {str(f.relative_to(HOST)) for f in HOST.rglob("*.py")
            if re.search(pattern, f.read_text(encoding="utf-8"), re.MULTILINE)}


@pytest.mark.slow
def test_the_forward_model_is_defined_once():
    assert found(r"return motor\(.*\) \+ friction\(") == {"dart_hal/vehicle/motor.py"}
    behind = found(r"^[A-Z_]+(, [A-Z_]+)* = 0\.0[12]0?\b +# s\b.*\b(grid|frames?|pulses)\b")
    above = found(r"^# s; .*\b(grid|frames?|pulses)\b.*\n(#.*\n)*[A-Z_]+ = 0\.0[12]0?$")
    assert behind | above == {"dart_hal/core/timing.py"}
    packages = {name.rpartition("/")[0] for name in found(r"\bNow\(") - {
        f"dart_lab/sim/{n}.py" for n in ("injected", "light/plant", "light/sense")}}  # tick by tick
    assert packages == {"dart_hal/vehicle", "dart_lab/identification/prediction"}
