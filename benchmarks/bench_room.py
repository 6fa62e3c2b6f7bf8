"""Pose estimates of hidden cars in a room with motion capture: through ``Car``, against the truth.

    python benchmarks/bench_room.py                       cars 1 to 20, 60 s at 1 m/s, calibrated
    python benchmarks/bench_room.py 3 30 0                cars 1 to 3, 30 s, nothing calibrated
    python benchmarks/bench_room.py 20 60 1 ,lock=6       with more wrong: false locks, 6 a minute
    python benchmarks/bench_room.py 20 60 1 "" 7          every bend 7 s long
    python benchmarks/bench_room.py 20 60 1 none 7 101    cars 101 to 120, dead reckoning alone

Bends to both sides, of changing length; of one length, they beat with the IMU's own clock
(docs/explanation/estimation.md). Poses of the marker at 10 Hz, 5 mm, with the seed's marker,
latency and clock; 0.5 s in every 5 s without poses. Calibrated: with the errors and standard errors
that the procedures have on car 1, drawn; their coverage is measured elsewhere.

Of ``State.estimate`` after the first 10 s: rms position error [cm] of the rear axle while tracking,
the largest in a gap, normalised error squared of x, y, yaw (mean; 3 when the covariance is
honest), the same of all five numbers predicted by 50 ms (5). Of dead reckoning: error at the end /
distance [%], normalised error squared.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import cos, hypot, sin, tau
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from figures import Figure
from scipy.stats import chi2

from dart_hal import Car
from dart_hal.calibration.measured import Measured, write
from dart_hal.core.config import CarFiles, Quantities, Quantity
from dart_hal.core.ports import PoseSource
from dart_hal.core.types import (
    START_FRAME,
    ExternalPose,
    FloatArray,
    MotionEstimate,
    Pose,
    State,
    Tracking,
)
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.mocap import MocapParams, parse_mocap
from dart_lab.sim.truth import reveal_url, world_of

SETTLED, EVERY, GAP = 10.0, 5.0, 0.5  # s
MOCAP_OPTIONS = "rate=10,noise=0.005,yaw_noise=0.005"
AHEAD = 5  # frames
STDS = {"encoder.metres_per_edge": 1.2e-6, "imu.gyro_bias": 9e-5, "imu.gyro_scale": 3.3e-4,
        "imu.mount_yaw": 1e-3, "imu.mount_pitch": 5e-5, "imu.mount_roll": 5e-5,
        "mocap.marker_x": 1.2e-4, "mocap.marker_y": 5e-5, "mocap.marker_yaw": 1e-4,
        "mocap.latency": 1.9e-3}
"""Standard errors of ``calibrate encoder``, ``imu``, ``mocap`` on car 1."""


class Gaps:
    """A source without poses in the last ``GAP`` s of every ``EVERY`` s."""

    on_board = False

    def __init__(self, source: PoseSource) -> None:
        self.name, self._source = source.name, source

    def poll(self, now: float) -> list[ExternalPose]:
        return [pose for pose in self._source.poll(now)
                if pose.arrival < SETTLED or pose.arrival % EVERY < EVERY - GAP]

    def close(self) -> None:
        self._source.close()


class Score(NamedTuple):
    """rms, in_gaps [m]; reckoned: share of the distance; the rest normalised errors squared."""

    rms: float
    in_gaps: float
    nees: float
    ahead: float
    reckoned: float
    nees_reckoned: float


class Drive(NamedTuple):
    """start (5,): the truth as the car was opened."""

    start: FloatArray
    frames: list[Frame]


class Frame(NamedTuple):
    """A State with the truth (5,) of its time."""

    state: State
    true: FloatArray


@contextmanager
def write_calibration(url: str, seed: int, mocap: bool) -> Iterator[str]:
    """A folder with calibration.toml of a hidden car: its truth, and errors as procedures have."""
    rng, true = np.random.default_rng([seed, 77]), reveal_url(open_backend(url).url)["sensors"]
    found: dict[str, Quantity | Quantities] = {
        name: Quantity(true[name] + std * float(rng.standard_normal()), std)
        for name, std in STDS.items() if mocap or not name.startswith("mocap")}
    found["encoder.ring"] = Quantities(tuple(true["encoder.ring"]), 2e-4)
    with tempfile.TemporaryDirectory() as folder:
        with Car.over(open_backend(url), cars=folder) as car:
            files: CarFiles = car.files
        write(files, Measured(files.config.name, url, "encoder", found, "drawn", 0.0))
        yield folder


def simulate_drive(seed: int, seconds: float, mocap: str, measured: bool = True, bend: float = 0.0,
           record: Path | None = None) -> Drive:
    """Simulate a drive of a hidden car, with motion capture unless ``mocap`` is empty.

    bend [s]: how long each pair of bends takes; 0.0: around 7, changing.
    """
    url = f"sim://?seed={seed}&nano=mock" + (f"&mocap={mocap}" if mocap else "")
    if not measured:
        return _drive(url, seconds, None, bend, record)
    with write_calibration(url, seed, bool(mocap)) as folder:
        return _drive(url, seconds, folder, bend, record)


def _drive(url: str, seconds: float, cars: str | None, bend: float, record: Path | None) -> Drive:
    backend = open_backend(url)
    world, frames = world_of(backend), []
    if backend.poses is not None:
        backend.poses = Gaps(backend.poses)
    with Car.over(backend, cars=cars, record=record) as car:
        start = motion_vector(world.truth())
        car.arm()
        begin = world.t
        for state in car.states(duration=seconds):
            frames.append(Frame(state, motion_vector(world.truth(state.t))))
            t = tau * (state.t - begin)
            phase = t / bend if bend else t / 7.0 + 3.0 * sin(t / 23.0)
            car.drive_speed(steering=0.25 * sin(phase), speed=1.0)
    return Drive(start, frames)


def score_drive(seed: int, seconds: float, mocap: str = MOCAP_OPTIONS, measured: bool = True,
           bend: float = 0.0) -> Score:
    """One hidden car; see the head of the file."""
    start, frames = simulate_drive(seed, seconds, mocap, measured, bend)
    params = parse_mocap(mocap, seed)
    assert params is not None
    late = [k for k, frame in enumerate(frames) if frame.state.t - frames[0].state.t > SETTLED
            and frame.state.estimate.frame != START_FRAME]
    tracking = np.array([frames[k].state.estimate.tracking is Tracking.TRACKING for k in late])
    off = np.array([pose_error(frames[k].state.estimate.pose, in_room(frames[k].true, params))
                    for k in late])
    error = np.hypot(off[:, 0], off[:, 1])
    honest = [normalised_errors(frames[k].state.estimate, in_room(frames[k].true, params))[0]
              for k in late]
    ahead = [normalised_errors(frames[k].state.estimate.predict(frames[k + AHEAD].state.t),
                        in_room(frames[k + AHEAD].true, params))[1] for k in late[:-AHEAD]]
    return Score(float(np.sqrt(np.mean(error[tracking]**2))),
                 float(error[~tracking].max(initial=0.0)), float(np.mean(honest)),
                 float(np.mean(ahead)), *score_dead_reckoning(Drive(start, frames)))


def score_dead_reckoning(drive: Drive) -> tuple[float, float]:
    """Error of dead reckoning at the end / distance, and its normalised error squared."""
    end = drive.frames[-1]
    distance = sum(hypot(*(b.true - a.true)[:2]) for a, b in pairwise(drive.frames))
    last = pose_error(end.state.pose, relative(end.true, drive.start))
    return (hypot(*last[:2]) / distance,
            float(last @ np.linalg.solve(end.state.pose.cov, last)))


def motion_vector(truth: Any) -> FloatArray:
    """x, y, yaw, speed, yaw rate."""
    return np.array((truth.x, truth.y, truth.yaw, truth.v_x, truth.yaw_rate))


def in_room(true: FloatArray, room: MocapParams) -> FloatArray:
    """A true pose, as the motion capture has it."""
    c, s = cos(room.yaw), sin(room.yaw)
    return np.array((room.x + c * true[0] - s * true[1], room.y + s * true[0] + c * true[1],
                     room.yaw + true[2], *true[3:]))


def relative(true: FloatArray, start: FloatArray) -> FloatArray:
    """A true pose in the frame of the true start."""
    c, s = cos(start[2]), sin(start[2])
    x, y, yaw = (true - start)[:3]
    return np.array((c * x + s * y, -s * x + c * y, yaw, *true[3:]))


def pose_error(pose: Pose, true: FloatArray) -> FloatArray:
    """Error (3,) of a pose; the yaw's within half a turn."""
    off = np.array((pose.x, pose.y, pose.yaw)) - true[:3]
    off[2] -= tau * round(off[2] / tau)
    return off


def normalised_errors(estimate: MotionEstimate, true: FloatArray) -> tuple[float, float]:
    """Normalised error squared of the pose, and of pose, speed and yaw rate."""
    off = np.array((*pose_error(estimate.pose, true), estimate.speed - true[3],
                    estimate.yaw_rate - true[4]))
    return (float(off[:3] @ np.linalg.solve(estimate.cov[:3, :3], off[:3])),
            float(off @ np.linalg.solve(estimate.cov, off)))


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; a ``scale`` takes so many of four cars."""
    cars = max(round(4 * scale), 1)
    table = np.array([score_drive(seed, 60.0) for seed in range(1, cars + 1)])
    mean, most = table.mean(axis=0), table.max(axis=0)
    low, high = chi2.interval(0.95, 3 * cars) / np.array(cars)
    note = f"{cars} hidden cars, 60 s at 1 m/s, calibrated"
    return [Figure("with 10 Hz poses of 5 mm: worst rms", 100.0 * most[0], "cm", None, 1.0, note),
            Figure("in gaps of 0.5 s: largest error", 100.0 * most[1], "cm", note=note),
            Figure("normalised error squared of x, y, yaw", mean[2], "", note="3 when honest"),
            Figure("dead reckoning: worst error / distance", 100.0 * most[4], "%", None, 1.0, note),
            Figure("its normalised error squared", mean[5], "", low, high, note="3 when honest")]


def main(cars: int = 20, seconds: float = 60.0, measured: int = 1, more: str = "",
         bend: float = 0.0, first: int = 1) -> None:
    """One line for each car, then the mean and the worst."""
    alone = more == "none"
    names = ("rms cm", "gap cm", "nees", "ahead", "reckoned %", "nees")[4 if alone else 0:]
    scales = (100.0, 100.0, 1.0, 1.0, 100.0, 1.0)[4 if alone else 0:]
    print(f"{'car':>5}", *(f"{name:>10}" for name in names))
    rows = []

    def show(name: str, row: FloatArray) -> None:
        print(f"{name:>5}", *(f"{value:10.2f}" for value in row), flush=True)

    for seed in range(first, first + cars):
        score = (score_dead_reckoning(simulate_drive(seed, seconds, "", bool(measured), bend))
                 if alone else
                 score_drive(seed, seconds, MOCAP_OPTIONS + more, bool(measured), bend))
        rows.append(np.array(score) * scales)
        show(str(seed), rows[-1])
    show("mean", np.mean(rows, axis=0))
    show("worst", np.max(rows, axis=0))


if __name__ == "__main__":
    kinds = int, float, int, str, float, int
    main(*(kind(text) for kind, text in zip(kinds, sys.argv[1:], strict=False)))
