"""Pose estimates of a hidden car: dead reckoning before and after calibration, the filter.

    python benchmarks/plot_room.py 1 docs/pictures/estimation_room.png

One minute of car 1 at 1 m/s, as ``bench_room.py`` drives it. Left: the end of the way, true and as
estimated, with ellipses of two sigma. Right: position error over time, and two sigma of it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import degrees
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from bench_room import MOCAP_OPTIONS, Drive, in_room, relative, simulate_drive

from dart_hal.core.types import FloatArray, Pose, State
from dart_lab.sim.mocap import parse_mocap

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Ellipse

INK, COLOURS = "#22313f", ("#c0504d", "#2a78b8", "#2e8b57")
SHOWN = 1000  # last frames of the way that are drawn on the left


def reckoned(state: State) -> Pose:
    return state.pose


def filtered(state: State) -> Pose:
    return state.estimate.pose


def main(seed: int, out: Path) -> None:
    """Drive three times, draw, write the PNG."""
    room = parse_mocap(MOCAP_OPTIONS, seed)
    assert room is not None
    plain = simulate_drive(seed, 60.0, MOCAP_OPTIONS, measured=False)
    known = simulate_drive(seed, 60.0, MOCAP_OPTIONS)

    def transform_poses(drive: Drive, pose_of: Callable[[State], Pose]
                        ) -> tuple[FloatArray, FloatArray]:
        """x, y and covariance of each frame, in the frame of the start."""
        start = in_room(drive.start, room)
        c, s = np.cos(start[2]), np.sin(start[2])
        turn = np.array(((c, s), (-s, c))) if pose_of is filtered else np.eye(2)
        origin = start[:2] if pose_of is filtered else np.zeros(2)
        poses = [pose_of(frame.state) for frame in drive.frames]
        places = np.array([(pose.x, pose.y) for pose in poses])
        return (places - origin) @ turn.T, np.array(
            [turn @ pose.cov[:2, :2] @ turn.T for pose in poses])

    names = ("dead reckoning, uncalibrated", "dead reckoning, calibrated",
             "filter, 10 Hz poses of 5 mm")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.4),
                                         gridspec_kw={"width_ratios": (1.0, 1.4)})
    for name, colour, drive, pose_of in zip(
            names, COLOURS, (plain, known, known), (reckoned, reckoned, filtered), strict=True):
        true = np.array([relative(frame.true, drive.start)[:2] for frame in drive.frames])
        places, covs = transform_poses(drive, pose_of)
        way(left, places, covs[-1], name, colour)
        t = np.array([frame.state.t for frame in drive.frames])
        right.plot(t - t[0], 100.0 * np.hypot(*(places - true).T), color=colour, lw=1.2)
        right.plot(t - t[0], 200.0 * np.sqrt(np.trace(covs, axis1=1, axis2=2)), color=colour,
                   lw=0.8, ls="--")
        if drive is known and pose_of is reckoned:
            left.plot(*true[-SHOWN:].T, color=INK, lw=2.5, alpha=0.35, label="true", zorder=0)
    left.set(xlabel="x [m]", ylabel="y [m]", title="the last 10 s of 60")
    left.axis("equal")
    right.set(xlabel="time [s]", ylabel="position error [cm]", yscale="log", ylim=(0.05, 500.0),
              title="error; dashed: two sigma as stated")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=9)
    figure.tight_layout(rect=(0.0, 0.07, 1.0, 1.0))
    figure.savefig(out, dpi=110)


def way(axes: Any, places: FloatArray, cov: FloatArray, name: str, colour: str) -> None:
    """The end of a way, and two sigma of its last place."""
    axes.plot(*places[-SHOWN:].T, color=colour, lw=1.2, label=name)
    values, vectors = np.linalg.eigh(cov)
    width, height = 4.0 * np.sqrt(values)
    axes.add_patch(Ellipse(places[-1], width, height, angle=degrees(np.arctan2(
        vectors[1, 0], vectors[0, 0])), color=colour, fill=False, lw=1.2))
    axes.plot(*places[-1], "o", color=colour, ms=4)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
