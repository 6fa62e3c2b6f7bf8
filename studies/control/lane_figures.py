"""How well hidden cars keep to the middle of a lane by their lidar alone, by their true rear axle.

    python -m studies.control.lane_figures --seeds 20 [--first 101] [--speed 1 2]
        [--map lane lane-s] [--car later] [--no-trim] [--calibrated]
    python -m studies.control.lane_figures --first 210 --plot docs/pictures/lane.png

Each car knows its steering wrongly by a trim of 1.5 deg and a gain of 5 %, its speed by 3 %, each
to a side that the seed draws, and nothing of how its lidar sits (yaw within 0.03 rad, scale within
1.5 %). --calibrated: as calibrations leave it instead. --no-trim: nothing is learnt on the way.
Errors are taken after the first 2 m, until the lane ends. Some 4 s a car. --plot: one in the S.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, radians, sin
from pathlib import Path

import numpy as np
from msgspec.structs import replace as replace_table

from dart_hal.car import Car
from dart_hal.control.follow import Phase
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.paths import Path as Track
from dart_hal.control.plant import plant_of
from dart_hal.core.config import Quantity, calibration_in, save_calibration, save_model
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.vehicle.file import model_of
from dart_lab.sim.lidar.lanes import LANE_PATHS, START_DISTANCE, lane_boards
from dart_lab.sim.truth import room_of_car, world_of
from studies.control.follow_figures import later, write_files

TRIM, GAIN, SPEED = radians(1.5), 0.05, 0.03
SETTLED = 2.0
"""m after which figures are taken."""


def spoil(folder: Path, seed: int) -> None:
    """Steering and speed of the car's files, wrong as above."""
    home = next(folder.glob("*/calibration.toml")).parent
    cal, rng = calibration_in(home, home.name), np.random.default_rng([seed, 901])
    trim, gain, speed = (rng.choice((-1.0, 1.0), 3) * (TRIM, GAIN, SPEED)).tolist()
    table = cal.steering.map
    told = tuple((a - trim) / (1.0 + gain) for a in table.angle_rad)
    edge = cal.encoder.metres_per_edge
    cal = replace_table(cal, steering=replace_table(cal.steering, map=replace_table(
        table, angle_rad=told)))
    save_calibration(cal.with_quantities({"encoder.metres_per_edge": Quantity(
        edge.value * (1.0 + speed), edge.std)}), home)


@dataclass(frozen=True)
class Drive:
    """t [s], way [m], true x, y [m] in the room, lateral error [m], true and wanted speed [m/s],
    learnt trim and mount [rad]: (n,) each."""

    follower: LaneFollower
    middle: Track
    t: np.ndarray
    s: np.ndarray
    x: np.ndarray
    y: np.ndarray
    error: np.ndarray
    speed: np.ndarray
    wanted: np.ndarray
    trim: np.ndarray
    mount: np.ndarray

    @property
    def figures(self) -> dict[str, float]:
        """rms and largest error [cm]; m that are left of the lane at the end."""
        settled = (self.s > self.s[0] + SETTLED) & (self.s < self.middle.length - 0.5)
        error = 100.0 * self.error[settled]
        return {"rms": float(np.sqrt(np.mean(error**2))), "max": float(np.abs(error).max()),
                "left": self.middle.length - float(self.s[-1])}


@contextmanager
def hidden(seed: int, name: str, kind: str = "paper", calibrated: bool = False
           ) -> Iterator[tuple[Car, Backend]]:
    """A hidden car in a lane."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sim://?seed={seed}&nano=mock&lidar=1&map={name}"
        if kind == "later":
            true = Path(folder) / "true.toml"
            save_model(model_of(later(seed)), true)
            url += f"&vehicle={true}"
        write_files(url + "&mocap=1", seed, Path(folder))
        if not calibrated:
            spoil(Path(folder), seed)
        backend = open_backend(url)
        with Car.over(backend, cars=folder) as car:
            yield car, backend


def driven(seed: int, speed: float, name: str, kind: str = "paper", learns: bool = True,
           calibrated: bool = False, distance: float = 30.0) -> Drive:
    """One drive of a hidden car from rest to the end of its lane."""
    rows = []
    with hidden(seed, name, kind, calibrated) as (car, backend):
        follower = LaneFollower(plant_of(car.files), speed, distance, 60.0)
        if not learns:
            follower.model.compare = lambda before, after: None
        world, (x0, y0, yaw0) = world_of(backend), room_of_car(backend).start
        armed = False
        for state in car.states(duration=60.0):
            steering, wanted = follower.answer(car.now, state.speed, car.lidar.scans())
            if follower.phase is Phase.ENDED:
                break
            if follower.phase is Phase.WAITING:
                continue
            if not armed:
                armed = True
                car.arm()
            car.drive_speed(steering=steering, speed=wanted)
            true, model = world.truth(), follower.model
            c, s = cos(yaw0), sin(yaw0)
            rows.append((true.t, x0 + c * true.x - s * true.y, y0 + s * true.x + c * true.y,
                         true.v_x, wanted, model.trim, model.mount))
    t, x, y, v, w, trim, mount = np.array(rows).T
    middle, s, error, ways = LANE_PATHS[name](), START_DISTANCE, [], []
    for px, py in zip(x, y, strict=True):
        s = middle.closest(px, py, s)
        error.append(middle.offset(px, py, s))
        ways.append(s)
    return Drive(follower, middle, t, np.array(ways), x, y, np.array(error), v, w, trim, mount)


def plot(seed: int, speed: float, file: Path) -> None:
    """The S with its boards, true lines and errors with what is learnt and without."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=(1.2, 1.0),
                                        layout="constrained")
    middle = LANE_PATHS["lane-s"]()
    for k, board in enumerate(lane_boards(middle)):
        floor.plot(*board.T, color="#22313f", lw=1.6, label="boards" if k == 0 else None)
    floor.plot(middle.x, middle.y, "k--", lw=0.8, label="middle")
    for learns, colour, name in ((False, "#d55e00", "nothing learnt"), (True, "#0072b2", "lane")):
        drive = driven(seed, speed, "lane-s", learns=learns)
        floor.plot(drive.x, drive.y, color=colour, lw=1.1)
        way.plot(drive.s - drive.s[0], 100.0 * drive.error, color=colour, lw=1.2,
                 label=f"{name}: {drive.figures['rms']:.1f} cm rms after 2 m")
    floor.set_aspect("equal")
    floor.set(xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"lane-s, {speed:g} m/s, hidden car {seed}, by its lidar alone", loc="left",
                    fontsize=9)
    way.axvline(SETTLED, color="0.6", lw=0.8)
    way.set(xlabel="way along the lane [m]", ylabel="true rear axle left of the middle [cm]")
    for axes in (floor, way):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper right")
    figure.savefig(file, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=101)
    parser.add_argument("--speed", type=float, nargs="*", default=[1.0])
    parser.add_argument("--map", choices=list(LANE_PATHS), nargs="*", default=list(LANE_PATHS))
    parser.add_argument("--car", choices=("paper", "later"), default="paper")
    parser.add_argument("--no-trim", action="store_true")
    parser.add_argument("--calibrated", action="store_true")
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    if given.plot:
        plot(given.first, given.speed[0], given.plot)
        return
    for name in given.map:
        for speed in given.speed:
            drives = [driven(seed, speed, name, given.car, not given.no_trim, given.calibrated)
                      for seed in range(given.first, given.first + given.seeds)]
            ends = [d.follower.why for d in drives]
            print(f"{given.car}, {name}, {speed:g} m/s, {len(drives)} cars; "
                  f"{sum(why == 'the lane ends' for why in ends)} drove it all")
            for what in drives[0].figures:
                values = np.array([d.figures[what] for d in drives])
                print(f"  {what:4s} median {np.median(values):.2f}, worst {values.max():.2f}, "
                      f"least {values.min():.2f}; " + " ".join(f"{v:.1f}" for v in values))
            print("  ", set(ends), flush=True)


if __name__ == "__main__":
    main()
