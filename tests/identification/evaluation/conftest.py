"""Simulated recordings with a known truth, and where the real ones are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.recording.dart import Grid, Reference
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.evaluation.cases import Case
from dart_lab.identification.prediction.actuators import actuator_outputs
from dart_lab.identification.prediction.windows import find_windows

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def excerpt() -> Path:
    return ROOT / "tests" / "recorded" / "data"


def empty_grid(n: int) -> Grid:
    """Nothing but zeros: 0.01 s, at rest."""
    zero = np.zeros(n)
    return Grid(0.01 * np.arange(n), zero, zero, zero, zero, zero, zero, zero, zero, zero,
                np.zeros(n, dtype=bool), Reference(0.09, 0.0, 0.0, "made up"))


def drive(p=PAPER, seconds: float = 20.0, throttle: float = 0.25, steering: float = 0.4,
          speed: float = 0.8, weave: float = 0.0, ramp: float = 0.0) -> Grid:
    """What a car with these parameters does: sampled as a recording, without any error."""
    t = 0.01 * np.arange(int(100 * seconds))
    held = 0.1 * np.floor(10.0 * t + 1e-9)  # commands come at 10 Hz
    g = replace(empty_grid(len(t)), throttle=throttle + ramp * held,
                steering=steering + weave * np.sin(2.0 * held))
    tau, delta = actuator_outputs(p, g)
    start = np.array([[0.3], [-0.2], [2.9], [speed], [0.0], [0.0]])
    after = rollout(p, start, tau[:-1, None], delta[:-1, None])[:, :, 0].T
    x, y, yaw, v_x, v_y, omega = np.concatenate([start, after], axis=1)
    return replace(g, x=x, y=y, yaw=yaw, v_x=v_x, v_y=v_y, omega=omega)


@pytest.fixture
def empty():
    return empty_grid


@pytest.fixture
def driven():
    """``driven(p, ..., file="a")`` -> a Case that this vehicle drove."""
    def make(p=PAPER, file: str = "made/up", **options) -> Case:
        g = drive(p, **options)
        return Case(file, g, find_windows(g))
    return make
