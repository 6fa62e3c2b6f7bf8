"""Where hidden cars are after a drive: dead reckoning, the filter without and with external poses.

    python benchmarks/bench_pose_filter.py              cars 1 to 10, 60 s at 1 m/s
    python benchmarks/bench_pose_filter.py 3 20         cars 1 to 3, 20 s

Bends to both sides. Without poses: position error at the end as a share of the distance, and the
normalised error squared of the pose (3 in the mean when its covariance is honest). With poses of
the rear axle, 1 cm and 0.3 deg, 20 Hz, 60 ms late: rms position error [cm] after the first 5 s, and
the mean normalised error squared. CPU microseconds per frame of the filter without and with poses.
"""

from __future__ import annotations

import sys
import time
from math import hypot, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np

from dart_hal import Car
from dart_hal.core.types import FloatArray, Pose
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.odometry import MotionStep, OdometryNoise
from dart_hal.estimation.pose_filter import PoseFilter
from dart_lab.sim.truth import world_of

STD = np.array((0.01, 0.01, radians(0.3)))
EVERY, LATE = 5, 6  # frames
LEARNT = 500  # frames until poses have shown the constant errors


class Frame(NamedTuple):
    """A State: what moved since the last one, dead reckoning and truth (3,)."""

    motions: list[MotionStep]
    reckoned: Pose
    true: FloatArray


class Drive(NamedTuple):
    start: FloatArray
    noise: OdometryNoise
    frames: list[Frame]


def driven(seed: int, seconds: float) -> Drive:
    """A drive of a hidden car; its odometry begins at the true pose, with the 2 s of arming."""
    backend = open_backend(f"sim://?seed={seed}&nano=mock")
    world, motions, frames = world_of(backend), [], []
    with Car.over(backend) as car:
        odometry = car._engine.telemetry.odometry
        plain = odometry.update

        def update(*args: Any) -> MotionStep:
            motions.append(plain(*args))
            return motions[-1]

        odometry.update = update  # type: ignore[method-assign]
        start = position(world.truth())
        odometry.reset(*start)
        car.arm()
        begin = world.t
        for state in car.states(duration=seconds):
            frames.append(Frame(motions.copy(), state.pose, position(world.truth(state.t))))
            motions.clear()
            bend = sin(2.0 * pi * (state.t - begin) / 7.0)
            car.drive_speed(steering=0.25 * bend, speed=1.0)
        return Drive(start, odometry.noise, frames)


def position(truth: Any) -> FloatArray:
    return np.array((truth.x, truth.y, truth.yaw))


def filtered(drive: Drive, seed: int | None) -> tuple[list[Pose], float]:
    """(pose of each frame, us of CPU per frame); ``seed`` of the external poses, None: none."""
    rng = np.random.default_rng(seed)
    pose_filter = PoseFilter(drive.noise)
    pose_filter.start(Pose(*drive.start, 1e-6 * np.eye(3)))
    poses, seconds = [], 0.0
    for k, frame in enumerate(drive.frames):
        measured = None
        if seed is not None and k % EVERY == 0 and k >= LATE:
            late = drive.frames[k - LATE].true + STD * rng.standard_normal(3)
            measured = Pose(*late, np.diag(STD**2))
        since = time.process_time()
        for motion in frame.motions:
            pose_filter.predict(*motion)
        if measured is not None:
            pose_filter.correct(measured, 0.01 * LATE)
        poses.append(pose_filter.estimate().pose)
        seconds += time.process_time() - since
    return poses, 1e6 * seconds / len(poses)


def judged(pose: Pose, true: FloatArray) -> tuple[float, float]:
    """(position error [m], normalised error squared of the pose)."""
    error = np.array((pose.x, pose.y, pose.yaw)) - true
    return hypot(error[0], error[1]), float(error @ np.linalg.solve(pose.cov, error))


def figures(seed: int, seconds: float) -> list[float]:
    drive = driven(seed, seconds)
    true = np.array([frame.true for frame in drive.frames])
    distance = float(np.hypot(*np.diff(true[:, :2], axis=0).T).sum())
    alone, cost = filtered(drive, None)
    helped, whole = filtered(drive, seed)
    dead, own = (judged(pose, true[-1]) for pose in (drive.frames[-1].reckoned, alone[-1]))
    late = np.array([judged(*pair) for pair in zip(helped, true, strict=True)][LEARNT:])
    return [100.0 * dead[0] / distance, dead[1], 100.0 * own[0] / distance, own[1],
            100.0 * float(np.sqrt(np.mean(late[:, 0]**2))), float(late[:, 1].mean()), cost, whole]


def main() -> None:
    """One line for each car, then the mean and the worst."""
    cars = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    print("car  reckoned %  NEES  filter %  NEES  with poses cm  NEES  us  us with poses")
    rows = []
    for seed in range(1, cars + 1):
        rows.append(figures(seed, seconds))
        print(f"{seed:4d} " + "  ".join(f"{x:8.3f}" for x in rows[-1]), flush=True)
    for name, of in (("mean", np.mean), ("worst", np.max)):
        print(f"{name:5}" + "  ".join(f"{x:8.3f}" for x in of(np.array(rows), axis=0)))


if __name__ == "__main__":
    main()
