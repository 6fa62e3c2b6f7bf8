"""The oldest versions that pyproject.toml allows are installed together, and work."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = "lab,gym,table"
PROGRAM = """
import gymnasium, numpy as np
from pathlib import Path
from dart_hal.car import Car
from dart_hal.estimation.localisation.grid import Grid, read_grid, write_grid
from dart_hal import to_dataframe
from dart_hal.core.figures import new_figure, save_figure

with Car.open("sim://?nano=mock", record="run.mcap") as car:
    car.arm()
    for state in car.states(duration=1.0):
        car.drive(steering=0.1, throttle=0.2)
assert len(to_dataframe("run.mcap")) > 90
cars = gymnasium.make_vec("dart_lab.sim.gym:DartCar-v0", num_envs=2)
cars.reset(seed=1)
cars.step(cars.action_space.sample())
occupied = np.eye(4, dtype=bool)
write_grid(Grid(occupied, ~occupied, 0.05, np.zeros(2)), Path("map.yaml"))
assert (read_grid(Path("map.yaml")).occupied == occupied).all()
save_figure(new_figure(), "figure.png")
import dart_lab.live.view.player
print("all good")
"""


@pytest.mark.slow
def test_lowest_versions_work_together(tmp_path):
    """gymnasium 1.0 was allowed though the vector environment needs 1.1."""
    uv = [sys.executable, "-m", "uv"]
    if subprocess.run([*uv, "--version"], capture_output=True, check=False).returncode:
        pytest.skip("uv is not installed (pip install -e '.[dev]')")
    python = tmp_path / "lowest" / "bin" / "python"
    install = [*uv, "pip", "install", "--quiet", "--python", str(python), "--resolution",
               "lowest-direct", "--only-binary", ":all:", "--no-binary", "dart-hal",
               f"dart-hal[{EXTRAS}] @ {ROOT.as_uri()}"]
    for command in ([*uv, "venv", "--quiet", "--python", "3.11", str(tmp_path / "lowest")],
                    install, [str(python), "-c", PROGRAM]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False,
                              env={**os.environ, "MPLBACKEND": "agg"})
        assert done.returncode == 0, done.stderr[-3000:]
    assert "all good" in done.stdout
