"""One emulated scan of a car that turns, in its room: by the pose of each beam, and by one pose.

    python benchmarks/plot_lidar.py 4 docs/pictures/lidar_scan.png

Car 4 drives a circle in ``sim://?lidar=1&map=room``. Left: the room and one revolution, as the
car's true mount and true poses place its beams. Right: the same beams placed by one pose.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

from dart_hal.car import Car
from dart_hal.core.types import FloatArray
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.lidar.params import hidden_lidar
from dart_lab.sim.truth import room_of_car, world_of

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection

INK, HIT, GLASS = "#22313f", "#c0504d", "#2a78b8"
TITLES = ("each beam by the pose at its own time", "all beams by the pose at the scan's end")


def main(seed: int, out: Path) -> None:
    """Drive, draw, write the PNG."""
    backend = open_backend(f"sim://?seed={seed}&nano=mock&lidar=1&map=room")
    with Car.over(backend) as car:
        car.arm()
        for _ in car.states(duration=3.0):
            car.drive_speed(steering=0.36, speed=1.0)
        scan = car.lidar.scans()[-1].mounted(hidden_lidar(seed).mount)
        room, poses = room_of_car(backend), world_of(backend).poses

    def pose_at(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, yaw = poses(t).T
        x0, y0, yaw0 = room.start
        c, s = np.cos(yaw0), np.sin(yaw0)
        return x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw

    x, y, yaw = pose_at(scan.t)
    ways = (pose_at, lambda t: pose_at(np.full(len(t), scan.t[-1])))
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 5.0), sharex=True, sharey=True)
    for axis, way, title in zip(axes, ways, TITLES, strict=True):
        for lines, colour, width in ((room.lines, INK, 1.2), (room.glass, GLASS, 3.0)):
            axis.add_collection(LineCollection(list(lines.reshape(-1, 2, 2)), colors=colour,
                                               linewidths=width))
        axis.plot(*scan.points(way).T, ".", color=HIT, markersize=3)
        axis.plot(x[-1], y[-1], "o", color=INK, markersize=6)
        axis.arrow(x[-1], y[-1], 0.35 * np.cos(yaw[-1]), 0.35 * np.sin(yaw[-1]),
                   color=INK, head_width=0.1)
        axis.set(title=title, aspect="equal", xlabel="x, m")
        axis.autoscale_view()
    axes[0].set_ylabel("y, m")
    figure.supxlabel(
        f"one revolution of {len(scan)} beams, {1e3 * np.ptp(scan.t):.0f} ms, of a car that turns "
        f"at {np.ptp(yaw) / np.ptp(scan.t):.1f} rad/s; blue: glass", fontsize=10)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
