"""Where the recordings are: the committed excerpt always, the full set where it is present."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

NAMES_A = ("elapsed time sensors", "current", "voltage", "acc x (IMU)", "acc y (IMU)", "W (IMU)",
           "vel encoder", "safety_value", "throttle", "steering")
NAMES_B = (*NAMES_A, "vicon time", "vicon x", "vicon y", "vicon yaw")


@pytest.fixture(scope="session")
def excerpt() -> Path:
    return Path(__file__).parent / "data"


def rows_a(n: int = 60, t0: float = 100.0) -> dict[str, np.ndarray]:
    """A car that drives a left circle at 0.1032 m/s per 2 counts, 10 Hz."""
    one = np.ones(n)
    table = {name: np.zeros(n) for name in NAMES_A}
    table["elapsed time sensors"] = t0 + 0.1 * np.arange(n)
    table["W (IMU)"] = 0.5 + 1e-3 * np.sin(np.arange(n))  # a gyro without noise is stuck
    table["vel encoder"] = 0.05161 * (10 + np.arange(n) % 9)
    table["safety_value"] = one
    table["throttle"] = 0.25 * one
    table["steering"] = 0.3 * one
    return table


def rows_b(n: int = 600, epoch: float = 1.7254e9, radius: float = 1.0,
           speed: float = 0.5) -> dict[str, np.ndarray]:
    """The same with motion capture at 100 Hz, sensor columns held over 10 rows."""
    a = rows_a(-(-n // 10))
    table = {k: np.repeat(v, 10)[:n] for k, v in a.items()}
    t = 0.01 * np.arange(n)
    turn = speed / radius * t
    table["vicon time"] = epoch + t
    table["vicon x"] = radius * np.sin(turn)
    table["vicon y"] = radius * (1.0 - np.cos(turn))
    table["vicon yaw"] = (turn + np.pi) % (2.0 * np.pi) - np.pi
    return table


@pytest.fixture
def write(tmp_path):
    """``write(table, name)`` -> path of a CSV of these columns."""
    def writer(table: dict[str, np.ndarray], name: str = "car_1.csv") -> Path:
        path = tmp_path / name
        lines = [",".join(table)]
        lines += [",".join(repr(float(v)) for v in row)
                  for row in zip(*table.values(), strict=True)]
        path.write_text("\r\n".join(lines) + "\r\n")
        return path
    return writer


@pytest.fixture
def table_a():
    return rows_a


@pytest.fixture
def table_b():
    return rows_b
