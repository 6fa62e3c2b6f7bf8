"""A platoon of emulated hidden cars, judged by where they truly are.

    python -m studies.control.platoon_figures cars --seeds 20 [--tracker lane]

Each of five cars has its own seed (platoon 1: 1 to 5, platoon 2: 6 to 10, ...), no calibration,
its lidar's poses and gaps, and 50 % of the messages lost. ``bias``: what their poses are wrong by
across at most, a wave of 20 s with its own phase for each car. Lateral errors are taken after the
first 3 s.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from math import cos, pi, sin
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from dart_hal.control.tracks import track_named
from dart_hal.core.types import MotionEstimate, Pose
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.grid import read_grid, write_grid
from dart_hal.estimation.localisation.source import LidarPoses
from dart_lab.sim.lidar.maps import room_of
from dart_lab.sim.truth import world_of

PROGRAM = Path(__file__).parents[2] / "examples" / "use_cases" / "platooning.py"
SETTLED = 3.0
PERIOD = 20.0
BOARD, DOOR = 0.425, 0.4
"""m from the middle to a board of a lane; of a door in it."""


def loaded() -> ModuleType:
    """The example as a module."""
    spec = importlib.util.spec_from_file_location(PROGRAM.stem, PROGRAM)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


example = loaded()


class Truth:
    """``each`` of a drive: x, y [m] in the room of every car and its speed [m/s], at each tick;
    pulses at its ESC: time of the falling edge [s of ``t``] and width [us]."""

    def __init__(self, places: list[str]) -> None:
        self.starts = [tuple(float(v) for v in at.split(",")) for at in places]
        self.t: list[float] = []
        self.xy: list[list[tuple[float, float]]] = []
        self.speed: list[list[float]] = []
        self.pulses: list[list[tuple[float, float]]] = [[] for _ in places]

    def __call__(self, fleet: Any, t: float, cars: Any) -> None:
        worlds = [world_of(car._engine.backend) for car in fleet.cars]
        if not self.t:
            for world, seen in zip(worlds, self.pulses, strict=True):
                world.watchers.append(partial(self._pulse, seen, world.t - t))
        self.t.append(t)
        true = [world.truth() for world in worlds]
        self.xy.append([_placed(at, one.x, one.y) for at, one in zip(self.starts, true,
                                                                     strict=True)])
        self.speed.append([one.v_x for one in true])

    @staticmethod
    def _pulse(seen: list[tuple[float, float]], begun: float, channel: int,
               pulse: tuple[float, float]) -> None:
        if channel == 1:
            rise, fall = pulse
            seen.append((fall - begun, 1e6 * (fall - rise)))


def _placed(at: tuple[float, ...], x: float, y: float) -> tuple[float, float]:
    c, s = cos(at[2]), sin(at[2])
    return at[0] + c * x - s * y, at[1] + s * x + c * y


def biased(bias: float, seed: int) -> Any:
    """``see`` of a drive: poses that are off to the left by a slow wave of so many m."""
    phase = np.random.default_rng([seed, 17]).uniform(0.0, 2.0 * pi, 16)

    def see(car: int, motion: MotionEstimate) -> MotionEstimate:
        off, pose = bias * sin(2.0 * pi * motion.t / PERIOD + phase[car]), motion.pose
        return replace(motion, pose=Pose(pose.x - off * sin(pose.yaw), pose.y + off * cos(pose.yaw),
                                         pose.yaw, pose.cov))

    return see


def straight(seed: int, bias: float = 0.0, cars: int = example.CARS, **how: Any
             ) -> tuple[Any, Truth]:
    """Five hidden cars down the corridor."""
    seeds = range(5 * seed - 4, 5 * seed - 4 + cars)
    path = example.Track([(example.LONG, 0.0)], closed=False, start=(0.5, 0.0, 0.0))
    truth = Truth(example.starts(path, cars))
    with tempfile.TemporaryDirectory() as folder:
        see = biased(bias, seed) if bias else None
        how = {"make": example.careful, "loss": 0.5, "each": truth, "see": see, **how}
        return example.straight(folder, seeds, **how), truth


def lane(folder: Any, until: float = example.LONG) -> Path:
    """The map of the corridor with a lane of boards in it up to ``until`` [m], which has a door to
    one side or the other every 1.5 m: by them a car knows how far along it is."""
    chart = example.corridor(folder)
    grid, rng = read_grid(chart), np.random.default_rng(2)
    walls = grid.occupied.copy()
    rows = [int((side - grid.origin[1]) / grid.cell) for side in (-BOARD, BOARD)]
    for row in rows:
        walls[row, 2:min(round(until / grid.cell), walls.shape[1] - 2)] = True
    for x in np.arange(1.0, example.LONG - 1.0, 1.5):
        begin = int((x + rng.uniform(0.0, 1.0)) / grid.cell)
        walls[rows[rng.integers(2)], begin:begin + round(DOOR / grid.cell)] = False
    write_grid(replace(grid, occupied=walls, free=grid.free & ~walls), chart)
    return Path(chart)


def on_track(seed: int, **how: Any) -> tuple[Any, Truth]:
    """Five hidden cars on the track ``vicon`` between its boards."""
    path, room = track_named("racetrack_vicon_2"), room_of("track", 0)
    places = example.starts(path, first=5.0)
    poses = [LidarPoses(map_of_lines(room.lines), tuple(float(v) for v in at.split(",")))
             for at in places]
    truth = Truth(places)
    urls = example.urls_of("track", places, range(5 * seed, 5 * seed + example.CARS))
    how = {"make": example.careful, "loss": 0.5, "each": truth, **how}
    return example.drive(urls, path, poses=poses, **how), truth


def gaps(truth: Truth) -> np.ndarray:
    """True net gaps (n, cars - 1) [m] along a straight."""
    x = np.array(truth.xy)[:, :, 0]
    return x[:, :-1] - x[:, 1:] - 0.30


def lateral(truth: Truth) -> float:
    """rms [m] of the true rear axles beside the straight."""
    t, y = np.array(truth.t), np.array(truth.xy)[:, :, 1]
    return float(np.sqrt(np.mean(y[t > SETTLED] ** 2)))


def scenario(seed: int) -> dict[str, Any]:
    """One of the random drives: who lies from when, how, and when the leader brakes."""
    rng = np.random.default_rng([seed, 5])
    car, since, size = int(rng.integers(0, 4)), rng.uniform(1.0, 8.0), 10.0 ** rng.uniform(-0.3, 3)
    kind, period = int(rng.integers(3)), rng.uniform(2.0, 20.0)

    def lie(t: float) -> float | None:
        if t < since:
            return None
        return (size, size * (1.0 if (t - since) % period < period / 2 else -1.0),
                float(np.random.default_rng([seed, int(10 * t)]).normal(0.0, size)))[kind]

    return {"lies": {car: lie}, "brakes": rng.uniform(6.0, 12.0), "lasts": 14.0}


def figures(seeds: Iterable[int], tracker: str = "lqr") -> None:
    """Of each seed: the random drive, at a bias of 2 cm; tracker "lane": between boards."""
    hall = lane if tracker == "lane" else example.corridor
    rms, least, touched = [], [], 0
    for seed in seeds:
        drive, truth = straight(seed, bias=0.02, tracker=tracker, hall=hall, **scenario(seed))
        rms.append(lateral(truth))
        least.append(gaps(truth).min())
        touched += len(drive.contacts) > 0
        found = [n for n, one in enumerate(drive.cars) if n and one.follower.detector.attacked]
        print(f"seed {seed}: lateral rms {100 * rms[-1]:.2f} cm, least net gap {least[-1]:.3f} m, "
              f"{len(drive.contacts)} contacts, found by cars {found}", flush=True)
    print(f"{len(rms)} platoons: lateral rms median {100 * np.median(rms):.2f}, worst "
          f"{100 * max(rms):.2f} cm; least net gap {min(least):.3f} m; {touched} with contacts")
