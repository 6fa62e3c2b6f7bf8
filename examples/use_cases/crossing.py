"""Four cars at an intersection agree who goes first, though every other message is lost.

Each plans by contouring control and stands before the line that the order of the cars gives it.
They tell each other over the room of the fleet; nobody is in charge.

    python examples/use_cases/crossing.py [picture.png [animation.gif]] [--plans]

The layout may be another: DART_HAL_CROSSING=roundabout. On real cars: change URLS and ROOM.
--plans: no order; each car keeps its distance from the plans that the others share.
"""

import os
import sys
import tempfile
from dataclasses import replace
from itertools import combinations
from math import cos, hypot, sin
from pathlib import Path

import numpy as np

from dart_hal import (
    UPSTREAM_2024,
    Calibration,
    Fleet,
    Quantity,
    model_of,
    plant_of,
    save_calibration,
    save_model,
)
from dart_hal.control.crossing.coordinator import Coordinator
from dart_hal.control.crossing.crosser import Crosser
from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.control.crossing.plan_crosser import PlanCrosser
from dart_hal.control.shared_plans.planner import PlanSharer
from dart_hal.control.shared_plans.space import PlanSpace

ROOM = os.environ.get("DART_HAL_ROOM", "local://crossing?loss=0.5&delay=0.02&jitter=0.03&seed=1")
LAYOUT = os.environ.get("DART_HAL_CROSSING", "intersection")
ROUTES = {"merge": (("lane", 1.0), ("lane", 0.0), ("ramp", 1.1), ("ramp", 0.1))}.get(
    LAYOUT, (("S-N", 0.3), ("E-W", 0.3), ("N-S", 0.3), ("W-E", 0.3)))  # route, start [m]
LASTS = 25.0  # s
AXLE = UPSTREAM_2024.body.l_r  # m that a car's middle is before its rear axle
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


def url(layout, route, s, world):
    """An emulated car whose middle is at s [m] of its route."""
    at = layout.routes[layout.number(route)].path.interpolate(s - AXLE)
    x, y, yaw = at.x, at.y, at.heading
    return (f"sim://?nano=mock&vehicle=upstream-2024&world={world}&at={x:.4f},{y:.4f},{yaw:.5f}"
            "&mocap=1")


def files(folder):
    """What an identification and `dart-hal calibrate mocap` write: the emulated cars' model, and
    markers on the rear axle."""
    cars = Path(folder) / "sim-0"
    cars.mkdir()
    save_model(model_of(replace(UPSTREAM_2024, name="sim-0")), cars / "model.toml")
    markers = {f"mocap.{of}": Quantity(0.0, std) for of, std in (
        ("marker_x", 1e-4), ("marker_y", 1e-4), ("marker_yaw", 1e-4), ("latency", 1e-3))}
    save_calibration(Calibration(car="sim-0").with_quantities(markers), cars)


def crossers(fleet, layout):
    """One for each car; in a lane the one that starts further on leads."""
    lanes = [layout.routes[layout.number(route)].lane for route, _ in ROUTES]
    all_ = []
    for k, (car, member, (route, s)) in enumerate(
            zip(fleet.cars, fleet.members, ROUTES, strict=True)):
        ahead = [(o, fleet.names[n]) for n, (_, o) in enumerate(ROUTES)
                 if lanes[n] == lanes[k] and o > s]
        mind = Coordinator(layout, fleet.names, fleet.names[k], route, s,
                           member.peers.boot or 1, leader=min(ahead)[1] if ahead else "")
        all_.append(Crosser(mind, plant_of(car.files)))
    return all_


def plan_crossers(fleet, layout):
    """The same cars, which share their plans."""
    space = PlanSpace([[layout.routes[layout.number(route)].path] for route, _ in ROUTES])
    return [PlanCrosser(PlanSharer(space, k, s, member.peers.boot or 1, car.now), layout, route,
                        plant_of(car.files))
            for k, (car, member, (route, s)) in enumerate(
                zip(fleet.cars, fleet.members, ROUTES, strict=True))]


def free(k, crosser, motions, lanes):
    """m to the middle of the next car in the same lane, here by its pose; else by the lidar."""
    ways = []
    for n, o in enumerate(motions):
        if n != k and lanes[n] == lanes[k]:
            x, y = middle(o.pose)
            at = crosser.path.interpolate(crosser.s)
            along = cos(at.heading) * (x - at.x) + sin(at.heading) * (y - at.y)
            ways += [along] if along > 0.0 else []
    return min(ways, default=float("inf"))


def middle(pose):
    return pose.x + AXLE * cos(pose.yaw), pose.y + AXLE * sin(pose.yaw)


def drive(layout, world="crossing", make=crossers):
    """Rows (t, x, y, yaw of each car, name of what it waits for), and the crossers."""
    lanes = [layout.routes[layout.number(route)].lane for route, _ in ROUTES]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        files(folder)
        urls = [url(layout, *start, world) for start in ROUTES]
        with Fleet.open(urls, cars=folder, room=ROOM) as fleet:
            minds = make(fleet, layout)
            fleet.arm()
            for states in fleet.states(duration=LASTS):
                motions = [state.estimate.predict(car.now)
                           for state, car in zip(states, fleet.cars, strict=True)]
                for k, (car, member, mind) in enumerate(
                        zip(fleet.cars, fleet.members, minds, strict=True)):
                    came = [(c.payload, c.age) for c in member.coordination().values()]
                    steering, speed, message = mind.answer(
                        motions[k], came, free(k, mind, motions, lanes))
                    if message:
                        member.tell_coordination(message)
                        member.tell_plan(mind.points(), step=0.1, frame=motions[k].frame)
                        car.log("crossing", mind.log_values)
                    car.drive_speed(steering=steering, speed=speed)
                rows.append((motions[0].t, [(*middle(m.pose), m.pose.yaw) for m in motions],
                             [str(mind.wait) for mind in minds]))
                if all(mind.is_done for mind in minds):
                    break
            return rows, minds, fleet.contacts


def figures(rows):
    """(least distance [m] between two middles, s from the first motion to the end)."""
    least = min(hypot(a[0] - b[0], a[1] - b[1]) for _, at, _ in rows
                for a, b in combinations(at, 2))
    first = np.array(rows[0][1])
    moved = next(t for t, at, _ in rows if np.abs(np.array(at)[:, :2] - first[:, :2]).max() > 0.02)
    return least, rows[-1][0] - moved


def floor(axes, layout, minds):
    """Lanes, and the ways of the cars."""
    for route in layout.routes:
        axes.plot(route.path.x, route.path.y, color="0.85", lw=7, solid_capstyle="round", zorder=0)
    for mind, colour in zip(minds, COLOURS, strict=True):
        entry = mind.path.interpolate(layout.entry[mind.route])
        c, s = 0.2 * cos(entry.heading), 0.2 * sin(entry.heading)
        axes.plot([entry.x - s, entry.x + s], [entry.y + c, entry.y - c], color=colour, lw=1.5)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")


def body(axes, x, y, yaw, colour, alpha=1.0):
    """A car, 0.30 by 0.20 m, at its middle; the patch."""
    from matplotlib.patches import Rectangle

    patch = Rectangle((x - 0.15, y - 0.1), 0.3, 0.2, angle=np.degrees(yaw),
                      rotation_point="center", color=colour, alpha=alpha, lw=0)
    axes.add_patch(patch)
    return patch


def label(mind, t0):
    """The stamp of an order, or how often a car changed its plan."""
    if isinstance(mind, PlanCrosser):
        return f"{mind.sharer.counts['ADOPTED']} plans"
    return f"stamp {mind.coordinator.car.ts * 1e-6 - t0:.2f} s"


def draw(layout, rows, minds, file):
    """Where the cars were each second, and how far along their ways."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.8), width_ratios=(1.0, 1.3),
                                         layout="constrained")
    floor(left, layout, minds)
    t0, t = rows[0][0], np.array([row[0] for row in rows])
    at = np.array([row[1] for row in rows])
    for k, (mind, colour) in enumerate(zip(minds, COLOURS, strict=True)):
        for i in range(0, len(rows), 100):
            body(left, *at[i, k], colour, 0.3 + 0.6 * i / len(rows))
        s = np.array([mind.path.s[np.argmin(np.hypot(mind.path.x - x, mind.path.y - y))]
                      for x, y in at[::10, k, :2]])
        route = layout.routes[mind.route].name
        right.plot(t[::10] - t0, s - layout.entry[mind.route], color=colour,
                   label=f"{route}, {label(mind, t0)}")
        waits = np.array([row[2][k] not in ("GOING", "DONE") for row in rows[::10]])
        right.plot((t[::10] - t0)[waits], (s - layout.entry[mind.route])[waits], ".",
                   color=colour, ms=7)
    right.axhspan(0.0, layout.exit[minds[0].route]
                  - layout.entry[minds[0].route], color="0.92", zorder=0)
    right.set(xlabel="t [s]", ylabel="middle of the car beyond its line [m]")
    right.set_title("dots: it waits, behind the line of a car before it or for its grant",
                    loc="left", fontsize=9)
    left.set_title("each second; the lines before the common ground", loc="left", fontsize=9)
    right.legend(fontsize=8, loc="upper left")
    right.grid(alpha=0.3)
    figure.savefig(file, dpi=100)


def animate(layout, rows, minds, file, every=10, fps=10):
    """The drive as a film in its own time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    figure, axes = plt.subplots(figsize=(5, 5), layout="constrained")
    floor(axes, layout, minds)
    drawn = []

    def frame(i):
        while drawn:
            drawn.pop().remove()
        t, at, waits = rows[i * every]
        for (x, y, yaw), wait, colour in zip(at, waits, COLOURS, strict=True):
            drawn.append(body(axes, x, y, yaw, colour))
            if wait not in ("GOING", "DONE"):
                drawn.append(axes.text(x + 0.2, y + 0.15, wait, fontsize=6, color=colour))
        axes.set_title(f"{t - rows[0][0]:.1f} s", loc="left", fontsize=9)
        return drawn

    FuncAnimation(figure, frame, frames=len(rows) // every).save(file, PillowWriter(fps), dpi=60)


def main(picture=None, animation=None, make=crossers):
    """(least distance [m], s for all), and the crossers."""
    layout = LAYOUTS[LAYOUT]()
    rows, minds, contacts = drive(layout, make=make)
    least, seconds = figures(rows)
    for mind, (route, _) in zip(minds, ROUTES, strict=True):
        named = [f"{t - minds[0].events[0][0]:.1f} s {' '.join(map(str, why))}".strip()
                 for t, *why in mind.events]
        print(f"{route}: {'; '.join(named)}{mind.why and ', ended: '}{mind.why}")
    across = sum(mind.is_done for mind in minds)
    print(f"{across} of {len(minds)} across in {seconds:.1f} s, middles at least {least:.3f} m "
          f"apart, {len(contacts)} contacts")
    if picture:
        draw(layout, rows, minds, picture)
    if animation:
        animate(layout, rows, minds, animation)
    return (least, seconds), minds


if __name__ == "__main__":
    files_given = [argument for argument in sys.argv[1:] if argument != "--plans"]
    main(*files_given, make=plan_crossers if "--plans" in sys.argv else crossers)
