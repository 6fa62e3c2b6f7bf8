"""Hidden cars for a crossing: faults drawn by their seeds, files as calibrations and an
identification leave them; poses of one motion capture with noise, or of each car's own lidar.

Cars 1 to 10 are drawn around the published set, 11 to 20 around the later one.
"""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from dart_hal.core.config import save_model
from dart_hal.estimation.localisation.grid import Grid, write_grid
from dart_hal.vehicle.file import model_of
from studies.control.follow_figures import later, write_files

SEEDS = 20
HALF, CELL = 5.5, 0.05
"""m from the middle of the hall to its walls, and of its map."""


def seeds(arrival: int, kind: str) -> list[int]:
    """Of the four cars of an arrival; alike, with one seed, where they come exactly alike."""
    rng = np.random.default_rng([arrival, 31])
    drawn = 1 + rng.choice(SEEDS, 4, replace=False)
    return [int(drawn[0])] * 4 if kind == "symmetric" else drawn.tolist()


class Hidden:
    """Writes the files of each car once into a folder of cars. lidar: of its poses."""

    def __init__(self, folder: Path, lidar: bool = False) -> None:
        self.folder, self.lidar = folder, lidar
        self.chart = hall(folder) if lidar else None

    def url(self, seed: int) -> str:
        """Of a car, as yet nowhere."""
        room = f"lidar=1&map={self.chart}" if self.lidar else "mocap=rate=50"
        url = f"sim://?seed={seed}&nano=mock&{room}"
        if seed > SEEDS // 2:
            true = self.folder / f"true-{seed}.toml"
            if not true.exists():
                save_model(model_of(later(seed)), true)
            url += f"&vehicle={true}"
        if not (self.folder / f"sim-{seed}").exists():
            write_files(url, seed, self.folder)
        return url

    def poses(self, at: str) -> str | None:
        """For ``Car.over``, of a car that begins at x, y, yaw."""
        return f"lidar:{self.chart}?start={at}" if self.lidar else None


def hall(folder: Path) -> Path:
    """The map of a hall about the crossing, with cabinets along its walls."""
    n = ceil(2.0 * HALF / CELL)
    walls = np.ones((n, n), dtype=bool)
    walls[1:-1, 1:-1] = False
    rng = np.random.default_rng(27)
    for at in rng.integers(5, n - 20, 2 * n // 25):
        deep, wide = rng.integers(2, 8), rng.integers(5, 15)
        side = slice(0, deep) if rng.random() < 0.5 else slice(-deep, None)
        along = slice(at, at + wide)
        walls[(side, along) if rng.random() < 0.5 else (along, side)] = True
    file = folder / "hall.yaml"
    write_grid(Grid(walls, ~walls, CELL, np.array((-HALF, -HALF))), file)
    return file
