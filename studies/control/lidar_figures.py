"""How closely the racetrack is followed by a car that knows its place by its lidar alone.

    python -m studies.control.lidar_figures --seeds 20 --speed 2 1 [--car later] [--laps 2]
    python -m studies.control.lidar_figures --seeds 10 --laps 10 --speed 2 --faults [--no-bridge]
    python -m studies.control.lidar_figures --seeds 4 --laps 1 --detect-cars
    python -m studies.control.lidar_figures --first 105 --plot docs/pictures/following_lidar.png

Hidden cars in halls about the track, as ``dart-hal follow --poses lidar:map.yaml`` drives them;
even seeds clockwise. The map is a grid of 2.5 cm, in which the car is searched. The hall has two
boxes that no map shows, and beams of 10 mrad that tell distances between both sides of an edge; the
head swings within a turn, and the lidar sits by what a calibration leaves. Errors are those of the
true rear axle after the first 3 m.

--faults: every 10 s no scan for 1 s, and the wheels 60 % too quick for 0.4 s; a second car drives
half a lap ahead. --no-bridge: a drive ends half a second after its last pose, as by poses
from outside. "lost": the drive did not end by its laps. --detect-cars: other cars in the scans are
waited for; without --faults there is none, and each wait is a false one.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, inf, pi, sin
from pathlib import Path as File

import numpy as np

from dart_hal import Car
from dart_hal.car.others import Others
from dart_hal.cli.follow import follow, make_follower, track_cars
from dart_hal.control.follow import Follower, Rules
from dart_hal.control.paths import Path
from dart_hal.control.tracks import track_named
from dart_hal.core.config import Quantity, calibration_in, save_calibration, save_model
from dart_hal.core.types import FloatArray, Scan
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.vehicle.file import model_of
from dart_lab.sim.arena import ArenaCar, enter_arena
from dart_lab.sim.lidar.maps import RoomMap, box, clearance
from dart_lab.sim.truth import reveal_url, room_of_car, world_of
from studies.control.follow_figures import later, write_files

CELL = 0.025
SITS = {"lidar.mount_x": 2e-4, "lidar.mount_y": 1e-4, "lidar.mount_yaw": 2.5e-4,
        "lidar.scale": 3e-5}
"""Standard errors that ``calibrate lidar`` states."""
SPOT = 0.01
"""rad: as wide as beams are apart."""
EVERY, GAP, SPINS, TOO_QUICK = 10.0, 1.0, 0.4, 0.6
"""s between faults of a kind; s without scans; s and share by which wheels are too quick."""
SETTLED = 3.0


@dataclass(frozen=True)
class Drive:
    """t [s], true x, y [m] in the hall, lateral error [m], way [m], true speed [m/s]: (n,) each,
    after the first 3 m; contacts with the other car; room: as the map shows it; waited [s]: behind
    other cars that were detected."""

    follower: Follower
    room: RoomMap
    t: FloatArray
    x: FloatArray
    y: FloatArray
    error: FloatArray
    way: FloatArray
    contacts: int
    waited: float

    @property
    def good(self) -> bool:
        return self.follower.why == "the path is driven"

    @property
    def figures(self) -> dict[str, float]:
        """rms and largest error [m]; flying lap against the profile's [-]."""
        laps = self.follower.driven.lap_times[1:]
        return {"rms": float(np.sqrt(np.mean(self.error**2))),
                "max": float(np.abs(self.error).max(initial=0.0)),
                "lap": float(np.mean(laps)) / self.follower.expected - 1.0 if laps else np.nan}


class Silent:
    """A lidar of which nothing comes for ``GAP`` s each ``EVERY`` s, from 6 s on."""

    def __init__(self, source) -> None:
        self.name, self.trouble, self._source = source.name, None, source

    def poll(self, now: float) -> Sequence[Scan]:
        return [scan for scan in self._source.poll(now)
                if scan.arrival < 6.0 or (scan.arrival - 6.0) % EVERY > GAP]

    def close(self) -> None:
        self._source.close()


def spinning(world) -> None:
    """Wheels that the encoder sees too quick for ``SPINS`` s each ``EVERY`` s, from 11 s on."""
    wheel = world.nano.set_wheel

    def turned(rate: float) -> None:
        spins = world.t > 11.0 and (world.t - 11.0) % EVERY < SPINS
        wheel(rate * (1.0 + TOO_QUICK * spins))

    world.nano.set_wheel = turned


class Other:
    """A second car of the world, half a lap ahead on the same track: it passes in the next lanes.

    ``follower``: whose progress it keeps up with; before there is one it stands.
    """

    def __init__(self, place: ArenaCar, path: Path) -> None:
        self.place, self._path, self._t = place, path, 0.0
        self.follower: Follower | None = None

    def until(self, t: float) -> None:
        s = self.follower.tracker.s if self.follower and len(self.follower.driven) else 0.0
        spot = self._path.interpolate(s + 0.5 * self._path.length)
        while self._t < t:
            self._t += 0.005
            self.place.trail(self._t, *spot[:3])


def grid_of(room: RoomMap, folder: File) -> File:
    """Its walls as map_server keeps them; glass is no wall."""
    low = room.lines.reshape(-1, 2).min(axis=0) - 0.2
    size = np.ceil((room.lines.reshape(-1, 2).max(axis=0) + 0.2 - low) / CELL).astype(int)
    shades = np.full(size[::-1], 254, np.uint8)
    for x1, y1, x2, y2 in room.lines:
        n = int(np.hypot(x2 - x1, y2 - y1) / (0.2 * CELL)) + 2
        i, j = ((np.linspace((x1, y1), (x2, y2), n) - low) / CELL).astype(int).T
        shades[j, i] = 0
    (folder / "map.pgm").write_bytes(b"P5 %d %d 255\n" % tuple(size) + shades[::-1].tobytes())
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nresolution: {CELL}\norigin: [{low[0]}, {low[1]}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    return folder / "map.yaml"


def moved(room: RoomMap, seed: int) -> RoomMap:
    """With two boxes that were not there when the map was made."""
    rng, path = np.random.default_rng([seed, 79]), track_named("racetrack_vicon_2")
    lines, new = room.lines, 0
    while new < 2:
        x, y, yaw = rng.uniform((-0.8, -0.8, 0.0), (5.3, 5.3, pi))
        if np.hypot(path.x - x, path.y - y).min() > 0.55 and clearance(lines, x, y) > 0.25:
            lines, new = np.vstack((lines, box(x, y, yaw, 0.3, 0.25))), new + 1
    return replace(room, lines=lines)


def files(url: str, seed: int, folder: File) -> None:
    """What the car knows: of itself as in ``follow_figures``, and of its lidar."""
    write_files(f"{url}&mocap=1", seed, folder)
    home = next(folder.glob("*/calibration.toml")).parent
    true, rng = reveal_url(Url.parse(url))["sensors"], np.random.default_rng([seed, 80])
    save_calibration(calibration_in(home, home.name).with_quantities({
        key: Quantity(true[key] + std * float(rng.normal()), std) for key, std in SITS.items()}),
        home)


def driven(seed: int, speed: float, kind: str = "later", tracker: str = "lqr", laps: int = 2,
           faults: bool = False, bridge: bool = True, detect: bool = False) -> Drive:
    """One drive of a hidden car from rest at the path's start; even seeds drive clockwise."""
    path = track_named("racetrack_vicon_2")
    path = path if seed % 2 else path.reversed()
    at = f"{path.x[0]},{path.y[0]},{path.heading[0]}"
    with tempfile.TemporaryDirectory() as name:
        folder = File(name)
        url = (f"sim://?seed={seed}&nano=mock&lidar=spot={SPOT}&map=hall&world=hall-{seed}&at={at}")
        if kind == "later":
            save_model(model_of(later(seed)), folder / "true.toml")
            url += f"&vehicle={folder / 'true.toml'}"
        files(url, seed, folder)
        backend = open_backend(url)
        trail, others = watched(backend, seed, path if faults else None)
        room = room_of_car(backend)
        chart = grid_of(room, folder)
        with Car.over(backend, cars=folder, poses=f"lidar:{chart}") as car:
            follower = make_follower(car, path, speed or inf, tracker, Rules(laps=laps), None)
            for other in others:
                other.follower = follower
            follower.silent = lambda: bridge and car.lidar.located
            detected = Others(None, follower, track_cars(car)) if detect else None
            follow(car, follower, (), detected)
            car.stop()
            contacts = len(backend.contacts())
        for other in others:
            other.place.leave()
    waited = sum(detected.summary["waited_s"].values()) if detected else 0.0
    return make_drive(follower, room, np.array(trail), contacts, waited)


def watched(backend: Backend, seed: int, path: Path | None
            ) -> tuple[list[tuple[float, ...]], list[Other]]:
    """The rows to be filled with t, x, y of the true axle in the hall, and who else drives.

    path: there are faults, and another car on it.
    """
    world, room, rows = world_of(backend), room_of_car(backend), []
    unit, trail, others = backend.lidar.unit, world.trail, []
    unit.set_room(moved(room, seed))
    if path is not None:
        x, y, yaw, _ = path.interpolate(0.5 * path.length)
        place = enter_arena(Url.parse(f"sim://?world=hall-{seed}&at={x},{y},{yaw}"), "other")
        place._turn, place.start = (1.0, 0.0), (0.0, 0.0, 0.0)  # its trail is told in the hall
        others.append(Other(place, path))
        backend.lidar = Silent(backend.lidar)
        spinning(world)
    x0, y0, yaw0 = room.start
    c, s = cos(yaw0), sin(yaw0)

    def note(t: float, x: float, y: float, yaw: float) -> None:
        for other in others:
            other.until(t)
        trail(t, x, y, yaw)
        rows.append((t, x0 + c * x - s * y, y0 + s * x + c * y))

    world.trail = note
    return rows, others


def make_drive(follower: Follower, room: RoomMap, trail: FloatArray, contacts: int,
             waited: float) -> Drive:
    """What was truly driven, every 10 ms, until the laps were over."""
    path, s, error, ways = follower.path, follower.begun_at, [], []
    end = follower.driven.table[-1, 0]
    t, x, y = trail[::2][trail[::2, 0] <= end].T
    for px, py in zip(x, y, strict=True):
        s = path.closest(px, py, s)
        error.append(path.offset(px, py, s))
        ways.append(s)
    way = np.array(ways) - follower.begun_at
    part = (way > SETTLED) & (way < follower.rules.laps * path.length)
    return Drive(follower, room, t[part], x[part], y[part], np.array(error)[part], way[part],
                 contacts, waited)


def plot(seed: int, speed: float, file: File) -> None:
    """The hall, and the true errors of two laps with faults and without."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 4.4), width_ratios=(1.0, 1.5),
                                        layout="constrained")
    for faults, colour, name in ((True, "#d55e00", "gaps of 1 s, spins, another car"),
                                 (False, "#0072b2", "no faults")):
        drive = driven(seed, speed, faults=faults)
        rms = 100.0 * drive.figures["rms"]
        floor.plot(drive.x, drive.y, color=colour, lw=1.0)
        way.plot(drive.way, 100.0 * drive.error, color=colour, lw=1.1,
                 label=f"{name}: {rms:.1f} cm rms")
    for k, (x1, y1, x2, y2) in enumerate(moved(drive.room, seed).lines):
        new = k >= len(drive.room.lines)
        floor.plot((x1, x2), (y1, y2), color="#e377c2" if new else "#22313f", lw=1.5)
    path = drive.follower.path
    floor.plot(np.append(path.x, path.x[:1]), np.append(path.y, path.y[:1]), "k--", lw=0.8)
    floor.set_aspect("equal")
    floor.set(xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"hidden car {seed}, {speed:g} m/s, by its lidar; pink: not in the map",
                    loc="left", fontsize=9)
    way.set(xlabel="way along the path [m]", ylabel="true rear axle left of the path [cm]")
    way.set_ylim(top=1.4 * way.get_ylim()[1])
    way.legend(fontsize=8, loc="upper right")
    floor.grid(alpha=0.3)
    way.grid(alpha=0.3)
    figure.savefig(file, dpi=100)


def told(drives: list[Drive]) -> None:
    """Median and worst of each figure."""
    for what in drives[0].figures:
        values = 100.0 * np.array([d.figures[what] for d in drives])
        print(f"  {what:4s} median {np.nanmedian(values):.2f}, worst "
              f"{np.nanmax(np.abs(values)):.2f} {'%' if what == 'lap' else 'cm'}; "
              + " ".join(f"{v:.1f}" for v in values))
    laps = sum(len(d.follower.driven.lap_times) for d in drives)
    print(f"  laps {laps}, lost {sum(not d.good for d in drives)}, contacts "
          f"{sum(d.contacts for d in drives)}, waited "
          f"{sum(d.waited for d in drives):.2f} s;", dict(Counter(d.follower.why for d in drives)),
          flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--speed", type=float, nargs="*", default=[2.0, 1.0])
    parser.add_argument("--car", choices=("paper", "later"), default="later")
    parser.add_argument("--tracker", default="lqr")
    parser.add_argument("--laps", type=int, default=2)
    parser.add_argument("--faults", action="store_true")
    parser.add_argument("--no-bridge", action="store_true")
    parser.add_argument("--detect-cars", action="store_true")
    parser.add_argument("--plot", type=File)
    given = parser.parse_args()
    if given.plot:
        plot(given.first, given.speed[0], given.plot)
        return
    for speed in given.speed:
        drives = [driven(seed, speed, given.car, given.tracker, given.laps, given.faults,
                         not given.no_bridge, given.detect_cars)
                  for seed in range(given.first, given.first + given.seeds)]
        print(f"{given.car}, hall, {given.tracker}, {speed:g} m/s, {len(drives)} cars"
              + (", faults" if given.faults else ""))
        told(drives)


if __name__ == "__main__":
    main()
