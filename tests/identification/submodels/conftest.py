"""Cars with known parameters, driven, and their recordings written as the recorder writes them.

Schemas A and B with what makes them hard: encoder counts of the last 0.1 s,
commands that show in the next message (0 to 0.1 s late, 0.05 s in the mean),
disturbances with a memory of 0.5 s, noise of the mocap, rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from dart_hal.recording.dart import Reference, read, with_marker_frames
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.step import make_car_step

DT = 0.01
COUNT = 0.00412708  # m
LATE = 0.05  # s, mean lateness of a command in the log
EPOCH = 1.7067e9  # February 2024: marker frame at (0.09, 0) m, -0.0164 rad
LX, THETA = 0.09, -0.0164
FRAME = Reference(LX, THETA, 0.0, "of the simulation")
HEAD_A = ("elapsed time sensors,current,voltage,acc x (IMU),acc y (IMU),W (IMU),vel encoder,"
          "safety_value,throttle,steering")
HEAD_B = HEAD_A + ",vicon time,vicon x,vicon y,vicon yaw"


@dataclass
class Drive:
    """Lanes (m, n): commands as given, state of the centre of mass, on a grid of 0.01 s."""

    throttle: np.ndarray
    steering: np.ndarray
    state: np.ndarray  # (6, m, n)

    @property
    def lanes(self) -> int:
        return len(self.throttle)


def drive(vehicle, throttle, steering, rng, disturbance=0.1, substeps=1) -> Drive:
    """Simulate m cars side by side; disturbance: std [m/s2] of a force with memory.

    substeps: tyres much stiffer than the paper's are stiff equations at low speed.
    """
    m, n = throttle.shape
    delayed = [np.pad(c, ((0, 0), (k, 0)), mode="edge")[:, :n] for c, k in (
        (throttle, round(vehicle.delay.throttle_s / DT)),
        (steering, round(vehicle.delay.steering_s / DT)))]
    step = make_car_step(vehicle, np, DT / substeps)
    state = [np.zeros(m) for _ in range(8)]
    push, out = np.zeros((2, m)), np.empty((6, m, n))
    keep = np.exp(-DT / 0.5)
    for i in range(n):
        out[:, :, i] = state[:6]
        for _ in range(substeps):
            state = list(step(*state, delayed[0][:, i], delayed[1][:, i]))
        push = keep * push + np.sqrt(1.0 - keep**2) * disturbance * rng.standard_normal((2, m))
        moves = np.abs(state[3]) > 0.05
        state[3] = state[3] + DT * push[0] * moves
        state[5] = state[5] + DT * push[1] * moves
    return Drive(throttle, steering, out)


def messages(d: Drive, lane: int, rng) -> np.ndarray:
    """Rows (k, 10) of schema A."""
    n = d.throttle.shape[1]
    t = np.arange(0.2 + 0.1 * rng.random(), DT * (n - 1), 0.1) + 0.002 * rng.standard_normal()
    grid = DT * np.arange(n)
    vx, om = d.state[3, lane], d.state[5, lane]
    way = np.concatenate([[0.0], np.cumsum(0.5 * DT * (vx[1:] + vx[:-1]))]) + COUNT * rng.random()
    counts = (np.floor(np.interp(t, grid, way) / COUNT)
              - np.floor(np.interp(t - 0.1, grid, way) / COUNT))
    at = np.floor(t / DT + 1e-9).astype(int)
    gyro = np.interp(t, grid, om) + 0.01 * rng.standard_normal(len(t))
    gyro = np.round(gyro / 0.00109083) * 0.00109083
    one, zero = np.ones(len(t)), np.zeros(len(t))
    return np.column_stack([100.0 + t, zero, zero, zero, zero, gyro, np.abs(counts) * COUNT / 0.1,
                            one, d.throttle[lane, at], d.steering[lane, at]])


def write_a(path, d: Drive, lane: int, rng):
    rows = messages(d, lane, rng)
    np.savetxt(path, rows, delimiter=",", fmt="%.9g", header=HEAD_A, comments="")
    return path


def write_b(path, d: Drive, lane: int, rng, l_r=PAPER.body.l_r):
    a = messages(d, lane, rng)
    n = d.throttle.shape[1]
    t = DT * np.arange(n)
    held = np.searchsorted(a[:, 0] - 100.0, t, side="right") - 1
    x, y, yaw = d.state[:3, lane]
    x = x + (LX - l_r) * np.cos(yaw) + 5e-5 * rng.standard_normal(n)
    y = y + (LX - l_r) * np.sin(yaw) + 5e-5 * rng.standard_normal(n)
    yaw = yaw - THETA + 3e-4 * rng.standard_normal(n)
    rows = np.column_stack([np.where((held >= 0)[:, None], a[np.maximum(held, 0)], 0.0),
                            EPOCH + t, x, y, (yaw + np.pi) % (2 * np.pi) - np.pi])
    np.savetxt(path, rows, delimiter=",", fmt="%.16g", header=HEAD_B, comments="")
    return path


@dataclass
class Workshop:
    """Everything a test needs, with its own folder."""

    folder: object

    def recordings(self, d: Drive, seed: int, schema: str = "A", lanes=None, name="car_1"):
        """Read back what was written, one recording per lane."""
        rng = np.random.default_rng(seed)
        out = []
        for lane in range(d.lanes) if lanes is None else lanes:
            path = self.folder / f"{name}_{schema}_{seed}_{lane}.csv"
            (write_a if schema == "A" else write_b)(path, d, lane, rng)
            out.extend(with_marker_frames([read(path)], FRAME))
        return out

    drive = staticmethod(drive)


@pytest.fixture(scope="module")
def workshop(tmp_path_factory) -> Workshop:
    return Workshop(tmp_path_factory.mktemp("drives"))


def throttle_steps(levels, rng, pulse=5.0, coast=3.5, delay_before=1.0) -> np.ndarray:
    """(m, n): nothing, a level, nothing; switched at times that fit no grid of 0.1 s."""
    n = round((delay_before + pulse + coast + 0.2) / DT)
    out = np.zeros((len(levels), n))
    for row, level in zip(out, levels, strict=True):
        begin = round((delay_before + 0.1 * rng.random()) / DT)
        row[begin:begin + round(pulse / DT)] = level
    return out


@pytest.fixture(scope="session")
def steps():
    return throttle_steps


@pytest.fixture(scope="session")
def lively():
    """The paper's car with delay and lag in both channels."""
    return replace(PAPER, delay=replace(PAPER.delay, throttle_s=0.09, throttle_lag_s=0.05,
                                        steering_s=0.10, steering_lag_s=0.08))


@pytest.fixture(scope="session")
def late() -> float:
    return LATE
