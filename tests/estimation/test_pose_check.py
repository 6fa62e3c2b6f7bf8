"""Poses in another convention, or are of another body, are named as such."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.pose_check import PoseComparison, find_fault


def drive(seed: int, weave: bool = False) -> PoseComparison:
    """Circles both ways (or a weave), a marker 0.1 m off the axle, wheels and gyro 2 % off."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 0.02)
    omega = np.sin(0.9 * t) * 1.2 if weave else np.where(t % 14.0 < 7.0, 0.9, -0.9)
    v = 0.4 + 0.2 * np.sin(0.3 * t)
    yaw = rng.uniform(-3, 3) + np.cumsum(omega * 0.02)
    pose = np.column_stack([np.cumsum(v * np.cos(yaw) * 0.02), np.cumsum(v * np.sin(yaw) * 0.02),
                            yaw])
    measured = pose.copy()
    measured[:, 0] += 0.1 * np.cos(pose[:, 2])
    measured[:, 1] += 0.1 * np.sin(pose[:, 2])
    measured += rng.normal(size=measured.shape) * (0.001, 0.001, 0.002)
    yaw = np.cumsum(1.02 * np.diff(pose[:, 2], prepend=pose[0, 2])) + rng.normal()
    step = 0.98 * v * 0.02
    car = np.column_stack([np.cumsum(step * np.cos(yaw)), np.cumsum(step * np.sin(yaw)), yaw])
    return PoseComparison(t, car, measured)


def change_poses(d: PoseComparison, how: str) -> PoseComparison:
    x, y, yaw = d.external.T
    rng = np.random.default_rng(99)
    return PoseComparison(d.t, d.car, np.column_stack({
        "mm": (1e3 * x, 1e3 * y, yaw), "cm": (1e2 * x, 1e2 * y, yaw),
        "deg": (x, y, np.degrees(yaw)), "left": (x, -y, -yaw),
        "left_deg": (x, -y, -np.degrees(yaw)),
        "y-up": (x, 0.1 + 1e-3 * rng.normal(size=len(x)), 1e-3 * rng.normal(size=len(x))),
        "mirrored": (x, -y, yaw), "swapped": (y, x, yaw), "turn": (x, y, yaw - np.pi / 2),
        "stands": (x[0] + 0 * x, y[0] + 0 * x, yaw[0] + 0 * x),
        "another": (2.0 * np.cos(0.2 * d.t), 2.0 * np.sin(0.2 * d.t), 0.2 * d.t + np.pi / 2),
    }[how]))


EXPECTED = {"mm": ("mm", "units=mm"), "cm": ("cm", "units=cm"), "deg": ("degrees", "angle=deg"),
            "left": ("left-handed", "hand=left"), "left_deg": ("degrees", "angle=deg&hand=left"),
            "y-up": ("y-up", ""), "mirrored": ("mirrored", ""), "swapped": ("mirrored", ""),
            "turn": ("x axis", "turn=90"), "stands": ("do not move", ""),
            "another": ("another body", "body=NAME")}


def add_jumps(d: PoseComparison) -> PoseComparison:
    """3 % of the poses are up to 2 m and 2 rad elsewhere."""
    rng = np.random.default_rng(5)
    jumps = rng.uniform(-2.0, 2.0, d.external.shape) * (rng.random(len(d.t)) < 0.03)[:, None]
    return PoseComparison(d.t, d.car, d.external + jumps)


@pytest.mark.parametrize("weave", [False, True])
def test_single_poses_that_jump_are_no_wrong_convention(weave):
    for seed in range(10):
        assert find_fault(add_jumps(drive(seed, weave))) is None
        wrong = find_fault(add_jumps(change_poses(drive(seed, weave), "left")))
        assert wrong is not None
        assert wrong.option == "hand=left"


@pytest.mark.parametrize("weave", [False, True])
@pytest.mark.parametrize("how", EXPECTED)
def test_each_wrong_convention_is_named(how, weave):
    words, option = EXPECTED[how]
    for seed in range(5):
        wrong = find_fault(change_poses(drive(seed, weave), how))
        assert wrong is not None
        assert words in wrong.what
        assert wrong.option == option


@pytest.mark.parametrize("weave", [False, True])
def test_right_poses_are_not_doubted(weave):
    assert [find_fault(drive(seed, weave)) for seed in range(40)] == [None] * 40


def test_a_car_that_hardly_drove_gives_no_result():
    d = drive(1)
    with pytest.raises(ValueError, match="too little"):
        find_fault(PoseComparison(d.t[:50], d.car[:50], d.external[:50]))
