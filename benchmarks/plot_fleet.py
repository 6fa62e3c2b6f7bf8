"""Four emulated cars of one world as the first of them knows them; and how soon a stop stops.

    python benchmarks/plot_fleet.py docs/pictures/fleet.png

Left: a corridor, one revolution of the first car's lidar, the true bodies, and the last known pose
of each other car with two sigma, of a room in which 30 % of the frames are lost. The last car has
not been heard for 0.6 s. Right: ``bench_fleet.stop_once`` of 24 seeds at two losses.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
from bench_fleet import SEEDS, stop_once

from dart_hal.car import Car, Fleet, join
from dart_hal.core.types import FloatArray, Pose
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.lidar.maps import box
from dart_lab.sim.light.world import Outline
from dart_lab.sim.truth import room_of_car, world_of

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Ellipse

INK, HIT, RECEIVED = "#22313f", "#c0504d", "#2a78b8"
PLACES = ((3.4, 0.75, 0.0), (5.2, 1.25, 0.05), (6.6, 0.8, 0.0), (8.2, 1.15, 0.0))
SILENT = 0.6
"""s for which the last car is not heard."""
BODY = Outline()
Placed = tuple[float, float, float]


def placed(pose: tuple[float, float, float], start: Placed) -> Placed:
    """A pose since ``start``, in the room."""
    c, s = np.cos(start[2]), np.sin(start[2])
    return (start[0] + c * pose[0] - s * pose[1], start[1] + s * pose[0] + c * pose[1],
            start[2] + pose[2])


def lines(axis: Axes, of: FloatArray, colour: str, width: float) -> None:
    axis.add_collection(LineCollection(list(of.reshape(-1, 2, 2)), colors=colour,
                                       linewidths=width))


def ellipse(axis: Axes, pose: Pose, start: Placed) -> None:
    """Two sigma of x and y."""
    x, y, _ = placed((pose.x, pose.y, pose.yaw), start)
    values, vectors = np.linalg.eigh(pose.cov[:2, :2])
    angle = np.degrees(start[2] + np.arctan2(vectors[1, 1], vectors[0, 1]))
    wide, long = 4.0 * np.sqrt(values)
    axis.add_patch(Ellipse((x, y), long, wide, angle=angle, fill=False, color=RECEIVED,
                           linewidth=1.2))
    axis.plot(x, y, "x", color=RECEIVED, markersize=5)


def corridor(axis: Axes) -> None:
    """Drive for 1.5 s, then draw what the first car measures and receives."""
    sees = "&lidar=rate=7,noise=0.01,dropout=0,lost=0&map=corridor"
    backends = [open_backend(f"sim://?nano=mock&seed={n + 1}&world=lab&at={x},{y},{yaw}"
                             + (sees if n == 0 else ""))
                for n, (x, y, yaw) in enumerate(PLACES)]
    with Fleet([Car.over(backend) for backend in backends]) as fleet:
        members = [join(car, "local://lab?loss=0.3&seed=4", name=str(n))
                   for n, car in enumerate(fleet.cars)]
        fleet.arm()
        for part in (0.9, SILENT):
            for _ in fleet.states(duration=part):
                for n, car in enumerate(fleet.cars):
                    car.drive_speed(steering=0.0, speed=0.6 + 0.1 * n)
            members[-1].close()
        fleet.cars[0].lidar.scans()
        for _ in fleet.states(duration=1.0):
            if scans := fleet.cars[0].lidar.scans():
                break
        truths = [placed((t.x, t.y, t.yaw), start) for t, start in
                  zip((world_of(b).truth() for b in backends), PLACES, strict=True)]
        lines(axis, room_of_car(backends[0]).lines, INK, 1.2)
        for x, y, yaw in truths:
            lines(axis, box(x + BODY.ahead * np.cos(yaw), y + BODY.ahead * np.sin(yaw), yaw,
                            BODY.length, BODY.width), INK, 1.5)
        scan = scans[-1].mounted(backends[0].lidar.unit._params.mount)
        poses = world_of(backends[0]).poses
        axis.plot(*scan.points(lambda t: np.array([placed(p, PLACES[0])
                                                   for p in poses(t)]).T).T,
                  ".", color=HIT, markersize=2.5)
        for name, other in members[0].other_poses().items():
            start = PLACES[int(name)]
            ellipse(axis, other.pose, start)
            x, y, _ = placed((other.pose.x, other.pose.y, 0.0), start)
            axis.annotate(f"{1e3 * other.age:.0f} ms" + (", lost" if other.lost else ""),
                          (x, y + 0.22), color=RECEIVED, fontsize=8, ha="center")
        axis.annotate("this car", (truths[0][0], truths[0][1] - 0.32), fontsize=8, ha="center")
    axis.set(xlim=(2.6, 11.6), ylim=(-0.3, 2.3), aspect="equal", xlabel="x, m", ylabel="y, m",
             title="red: one revolution of the first car's lidar; blue: last known poses, 2 sigma")


def stops(axis: Axes) -> None:
    bins = np.arange(0.0, 101.0, 10.0)
    for loss, colour in ((0.0, INK), (0.5, HIT)):
        found = [1e3 * stop_once(f"local://plot?loss={loss}&seed={n}", n) for n in range(SEEDS)]
        axis.hist(found, bins, color=colour, alpha=0.75,
                  label=f"{loss:.0%} of the frames lost: up to {max(found):.0f} ms")
    axis.set(xlabel="ms from the call to the end of the last driving pulse", ylabel="of 24 seeds",
             title="stop all, at the ESC of the other car")
    axis.legend(fontsize=8)


def main(out: Path) -> None:
    """Draw and write the PNG."""
    figure, axes = plt.subplots(2, 1, figsize=(9.6, 6.4), height_ratios=(1.0, 0.85))
    corridor(axes[0])
    stops(axes[1])
    figure.tight_layout()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
