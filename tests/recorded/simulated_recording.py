"""Recordings of a simulated car whose marker frame is known, and their CSV files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.dart.model import freeze
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import PAPER
from dart_lab.diagnosis.suggest.virtual import VirtualCommands, record

# m, rad: of a motion capture
POSITION_NOISE = 5e-4
YAW_NOISE = 2e-3


def random_frame(rng: np.random.Generator) -> Reference:
    """Markers anywhere on the car, turned by up to 17 degrees."""
    return Reference(rng.uniform(-0.05, 0.25), rng.uniform(-0.3, 0.3), rng.uniform(-0.03, 0.03),
                     "of the simulation")


def random_commands(rng: np.random.Generator, seconds: float,
                    steering: float = 0.9) -> VirtualCommands:
    """Steering levels of 0.3 to 1.5 s within +-steering, throttle levels of 1.5 to 4 s."""
    n = int(100 * seconds)
    steps = np.zeros(n)
    throttle = np.zeros(n)
    i = 0
    while i < n:
        length = int(rng.uniform(30, 150))
        steps[i:i + length] = rng.uniform(-steering, steering)
        i += length
    i = 0
    while i < n:
        length = int(rng.uniform(150, 400))
        throttle[i:i + length] = rng.uniform(0.2, 0.45)
        i += length
    return VirtualCommands(throttle, steps)


def simulate_recording(seed: int, base: Vehicle = PAPER, seconds: float = 60.0,
                       steering: float = 0.9,
                       frame: Reference | None = None) -> tuple[Recording, Reference]:
    """(recording with the noise of a motion capture, its marker frame)."""
    rng = np.random.default_rng(seed)
    frame = frame or random_frame(rng)
    made = record(base, random_commands(rng, seconds, steering), frame, f"simulated_{seed}")
    return noisy(made, rng), frame


def noisy(made: Recording, rng: np.random.Generator) -> Recording:
    """With the noise of a motion capture."""
    m = made.mocap
    assert m is not None
    n = len(m)
    return replace(made, mocap=replace(
        m, x=freeze(m.x + rng.normal(0.0, POSITION_NOISE, n)),
        y=freeze(m.y + rng.normal(0.0, POSITION_NOISE, n)),
        yaw=freeze(m.yaw + rng.normal(0.0, YAW_NOISE, n))))


def table_of(recording: Recording, schema: str = "C") -> dict[str, np.ndarray]:
    """Columns of a recording as a CSV file of schema B or C has them."""
    pose = recording.mocap
    m = recording.messages
    assert pose is not None
    last = np.maximum(np.searchsorted(m.arrival, pose.t, side="right") - 1, 0)
    yaw = (pose.yaw + np.pi) % (2.0 * np.pi) - np.pi
    start = pose.epoch or 0.0
    columns = {"vicon time": start + pose.t, "vicon x": pose.x, "vicon y": pose.y,
               "vicon yaw": yaw, "throttle": m.throttle_raw[last], "steering": m.steering[last],
               "safety_value": np.ones(len(pose))}
    if schema == "B":
        columns |= {"elapsed time sensors": 50.0 + m.t[last], "acc x (IMU)": m.accel_x[last],
                    "acc y (IMU)": m.accel_y[last], "W (IMU)": m.yaw_rate[last],
                    "vel encoder": m.speed[last]}
    return columns


def write_table(columns: dict[str, np.ndarray], path: Path) -> Path:
    """A CSV file of these columns."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path
