"""What an import costs: CPU from a CSV file of a minute at 100 Hz to a checked recording."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from figures import Figure

from dart_hal.recording.imported import write_imported
from dart_lab.importing import check_data, convert_tables, load_map, read_tables

SECONDS = 60.0
RATE = 100.0
RUNS = 5
COLUMNS = ("vicon time", "vicon x", "vicon y", "vicon yaw", "steering", "throttle", "safety_value",
           "vel encoder", "W (IMU)", "acc x (IMU)", "acc y (IMU)", "elapsed time sensors")


def write_log(path: Path, seconds: float) -> None:
    """Write a CSV file with the columns of the map "dart": a figure of eight at constant speed."""
    t = np.arange(0.0, seconds, 1.0 / RATE)
    speed = np.full(len(t), 1.5)
    yaw_rate = 1.2 * np.sin(0.8 * t)
    yaw = np.cumsum(yaw_rate) / RATE
    x = np.cumsum(speed * np.cos(yaw)) / RATE
    y = np.cumsum(speed * np.sin(yaw)) / RATE
    rows = np.stack([t, x, y, yaw, 0.5 * yaw_rate, 0.2 * speed, np.ones(len(t)), speed, yaw_rate,
                     np.zeros(len(t)), speed * yaw_rate, t + 1.0], axis=1)
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(COLUMNS), comments="")


def import_log(log: Path, target: Path) -> float:
    """Import a log as `dart-hal data import` does. Returns the CPU time [s]."""
    begin = time.process_time()
    mapping, text = load_map("dart")
    data = convert_tables(read_tables([log]), mapping, text)
    findings = check_data(data)
    write_imported(data, target)
    spent = time.process_time() - begin
    assert not any(f.severe for f in findings), findings
    return spent


def cost(scale: float = 1.0) -> float:
    """Return the CPU time [s] of an import of a minute: the least of some runs."""
    seconds = SECONDS * scale
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        write_log(log, seconds)
        best = min(import_log(log, Path(folder) / "run.mcap") for _ in range(RUNS))
    return best / scale


def figures(scale: float = 1.0) -> list[Figure]:
    return [Figure("import, CPU for a minute of 100 Hz", cost(scale), "s", high=1.0)]


if __name__ == "__main__":
    print(f"{cost():.2f} s of CPU for a minute of 100 Hz")
