"""Compare curvature-aware contouring control with the plain one on the same track.

One emulated car with hidden lags, which `diagnose` names from two recorded drives. By the model so
extended four controllers drive a lap of the 22.92 m track: MPCC and CA-MPCC, each by the published
weights and by tuned ones. Then CA-MPCC passes a virtual obstacle that moves on in its lane.

    python examples/use_cases/curvature_aware.py [picture.png [animation.gif]]

A real car brings its own model.toml: DART_HAL_URL="serial:///dev/ttyUSB0?i2c=1" and
DART_HAL_POSES="natnet://.." beside the same line; the path begins where it stands.
"""

import io
import os
import sys
import tempfile
from functools import partial
from math import cos, sin
from pathlib import Path
from typing import NamedTuple

import numpy as np
from diagnosis_in_control import KNOWN, found_of, url

from dart_hal import (
    Car,
    Follower,
    Law,
    Obstacle,
    Phase,
    Rules,
    curvature_aware,
    model_of,
    plant_of,
    save_model,
    track_named,
)
from dart_hal.control.curvature_aware.generator import TUNED, PathWeights

URL = os.environ.get("DART_HAL_URL")  # None: the emulated car with hidden lags
TRACK = track_named("racetrack_vicon_2")
SPEED, LOST, BEHIND = 2.0, 1.0, 3.0  # m/s; m beside the path that end a drive; m not counted
ROLL, WALK = 2.0, 0.7  # m at m/s in which the room finds where an uncalibrated marker sits
LANE = 0.30  # m to either side
AHEAD, BESIDE, RADIUS, PACE = 4.0, 0.15, 0.15, 0.5  # m, m, m, m/s of the obstacle
DRIVES = {"MPCC, published": (Law.MPCC, PathWeights()), "MPCC, tuned": (Law.MPCC, TUNED),
          "CA-MPCC, published": (Law.CA, PathWeights()), "CA-MPCC, tuned": (Law.CA, TUNED)}
COLOURS = ("#d55e00", "#e69f00", "#0072b2", "#009e73")
BODY = np.array([(-0.06, -0.1), (0.24, -0.1), (0.24, 0.1), (-0.06, 0.1)])  # m, from the rear axle


class Drive(NamedTuple):
    """offset (n, 2): way along the path, offset [m] by the poses; plans: way [m], progress error of
    its end [m], t [s], pose, generated path (16, 2), obstacle's place or None."""

    follower: Follower
    offset: np.ndarray
    plans: list

    def figures(self):
        """rms of the plan's error and of the offset, largest offset [m], times out of the lane."""
        counted = self.offset[self.offset[:, 0] > BEHIND, 1]
        ends = np.array([plan[1] for plan in self.plans if plan[0] > BEHIND])
        out = (np.abs(counted) > LANE).astype(int)
        return (float(np.sqrt(np.mean(ends**2))), float(np.sqrt(np.mean(counted**2))),
                float(np.abs(counted).max()), int((np.diff(out, prepend=0) > 0).sum()))


def drive(where, cars, law, weights, obstacle=False):
    """One lap."""
    make = partial(curvature_aware, law=law, path_weights=weights)
    plans, seen, rolled = [], None, URL is not None
    with Car.open(where, cars=cars) as car:
        follower = Follower(TRACK, plant_of(car.files), SPEED, make,
                            Rules(1.0, duration=60.0, lane=LOST, here=True))
        car.arm()
        for state in car.states(duration=90.0):
            rolled = rolled or state.pose.x > ROLL
            if not rolled:
                car.drive_speed(steering=0.0, speed=WALK)
                continue
            motion = state.estimate.predict(car.now)
            steering, speed = follower.answer(motion)
            if follower.phase is Phase.ENDED:
                break
            car.drive_speed(steering=steering, speed=speed)
            tracker = follower.tracker
            if tracker.plan is None or tracker.plan is seen:
                continue
            seen, layers = tracker.plan, tracker.mpcc
            if obstacle and not layers.obstacles:
                layers.obstacles = (Obstacle(tracker.s + AHEAD, BESIDE, RADIUS, PACE, motion.t),)
            plans.append((tracker.s - follower.begun_at,
                          seen.way.error(layers.reference, seen.s[0])[-1], motion.t, motion.pose,
                          seen.way.states[:, :2], place(follower.path, layers.obstacles, motion.t)))
    table = follower.driven.table
    return Drive(follower, np.column_stack([table[:, 6] - follower.begun_at, table[:, 3]]), plans)


def place(path, obstacles, t):
    """x, y [m] of the obstacle, None without one."""
    if not obstacles:
        return None
    o = obstacles[0]
    spot = path.interpolate(o.s + o.speed * (t - o.t))
    return spot.x - o.offset * sin(spot.heading), spot.y + o.offset * cos(spot.heading)


def air(found):
    """Least distance [m] of the body to the obstacle, at the times of the plans."""
    least = np.inf
    for _, _, _, pose, _, at in found.plans:
        dx, dy, c, s = at[0] - pose.x, at[1] - pose.y, cos(pose.yaw), sin(pose.yaw)
        beyond = np.abs((dx * c + dy * s - 0.09, dy * c - dx * s)) - (0.15, 0.1)
        least = min(least, float(np.hypot(*np.maximum(beyond, 0.0))) - RADIUS)
    return least


def lane(axes, path):
    """The path and both edges of its lane."""
    for beside, style in ((-LANE, "-"), (0.0, "--"), (LANE, "-")):
        x, y = path.x - beside * np.sin(path.heading), path.y + beside * np.cos(path.heading)
        axes.plot(np.append(x, x[:1]), np.append(y, y[:1]), style, color="0.6", lw=0.7)
    axes.set_aspect("equal")


def draw(drives, file):
    """Lines of the four laps, progress errors of their plans, offsets."""
    from matplotlib import pyplot as plt

    figure = plt.figure(figsize=(11, 4.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.5))
    floor, ends, way = (figure.add_subplot(at) for at in (grid[:, 0], grid[0, 1], grid[1, 1]))
    lane(floor, TRACK)
    for (name, found), colour in zip(drives.items(), COLOURS, strict=True):
        plan, error, _, _ = found.figures()
        x, y = line(found)
        floor.plot(x, y, color=colour, lw=1.0)
        ends.plot([p[0] for p in found.plans], [100.0 * p[1] for p in found.plans], color=colour,
                  lw=1.0, label=f"{name}: {100.0 * plan:.1f} cm rms")
        way.plot(found.offset[:, 0], 100.0 * found.offset[:, 1], color=colour, lw=1.0,
                 label=f"{name}: {100.0 * error:.1f} cm rms")
    for edge in (-LANE, LANE):
        way.axhline(100.0 * edge, color="0.6", lw=0.7)
    floor.set(xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"one lap, {SPEED:g} m/s, by the diagnosed model", loc="left", fontsize=9)
    ends.set(ylabel="progress too much at\nthe plan's end [cm]")
    way.set(xlabel="way along the path [m]", ylabel="rear axle left of\nthe path [cm]")
    for axes in (ends, way):
        axes.set_ylim(top=2.2 * axes.get_ylim()[1])
        axes.legend(fontsize=7, ncols=2, loc="upper right")
    for axes in (floor, ends, way):
        axes.grid(alpha=0.3)
    figure.savefig(file, dpi=100)


def line(found):
    """x, y of a drive, laid on the track as it is drawn."""
    s, left = found.offset.T
    spots = np.array([TRACK.interpolate(at)[:3] for at in s])
    return spots[:, 0] - left * np.sin(spots[:, 2]), spots[:, 1] + left * np.cos(spots[:, 2])


def animate(found, file):
    """Car, generated path and obstacle, while it is near."""
    from matplotlib import pyplot as plt
    from PIL import Image

    frames = []
    for _, _, _, pose, ahead, at in found.plans[:70]:
        figure, axes = plt.subplots(figsize=(4.4, 4.4), dpi=70, layout="constrained")
        lane(axes, found.follower.path)
        axes.plot(*ahead.T, color=COLOURS[2], lw=2.0)
        if at is not None:
            axes.add_patch(plt.Circle(at, RADIUS, color=COLOURS[0]))
        c, s = cos(pose.yaw), sin(pose.yaw)
        axes.fill(*(BODY @ [[c, s], [-s, c]] + (pose.x, pose.y)).T, color="#22313f")
        axes.set(xticks=(), yticks=())
        buffer = io.BytesIO()
        figure.savefig(buffer)
        plt.close(figure)
        frames.append(Image.open(buffer).convert("RGB"))
    palette = frames[0].quantize(32, method=Image.Quantize.MAXCOVERAGE)
    frames = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=100, loop=0,
                   optimize=True)


def main(picture=None, animation=None):
    """{drive: (plan's error, rms, largest [m], times out of the lane)}, distance [m] kept to the
    obstacle."""
    with tempfile.TemporaryDirectory() as folder:
        where, cars = URL, None
        if URL is None:
            where, cars = url(folder), Path(folder) / "cars"
            found = found_of(where, folder)
            print("found " + ", ".join(cause.effect for cause in found.causes), flush=True)
            with Car.open(where) as car:
                name = car.files.config.name
            (cars / name).mkdir(parents=True)
            save_model(model_of(found.extended or KNOWN), cars / name / "model.toml")
        go = partial(drive, where, cars)
        drives = {name: go(*how) for name, how in DRIVES.items()}
        passing = go(Law.CA, TUNED, obstacle=True)
    for name, found in (*drives.items(), ("past the obstacle", passing)):
        plan, rms, most, out = found.figures()
        print(f"{name:20s} plan {100 * plan:5.2f} cm, car {100 * rms:5.1f} cm rms, "
              f"{100 * most:5.1f} at most, {out} times out of the lane; {found.follower.why}")
    print(f"least distance of the body to the obstacle {100 * air(passing):.1f} cm")
    if picture:
        import matplotlib

        matplotlib.use("Agg")
        draw(drives, picture)
        if animation:
            animate(passing, animation)
    return {name: found.figures() for name, found in drives.items()}, air(passing)


if __name__ == "__main__":
    main(*sys.argv[1:])
