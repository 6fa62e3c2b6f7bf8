"""Persistent monitoring: cars spread over a Lissajous curve, and no target escapes them.

Emulated cars in one room, each with a program of its own state: it knows its place by its lidar (or
a motion capture), hears the phases of the others over a room that loses 30 % of the frames, and
drives by the time-inverted Kuramoto law. Drawn is where a target could be that nobody saw yet,
however fast it is.

    python examples/use_cases/monitoring.py [picture.png [animation.gif]]

On real cars: URLS of serial:// and ROOM of udp://, with `car=` names in `Fleet.open`, the rest is
the same (docs/use_cases/monitoring.md).
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from dart_hal import Fleet, Grid, plant_of, write_grid
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.detection import coverage, hidden_regions
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.kuramoto import disagreement
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.monitoring.monitor import Monitor
from dart_hal.control.monitoring.peer import PLAN_STEP

TEAM = Formation(Lissajous(3.9, 7.8, 3, 2), 5, 2)
OMEGA, COUPLING = 0.07, 0.14  # rad/s: of the formation, 0.4 to 1.4 m/s; K / N
ROOM = "local://monitoring?loss=0.3&seed=1"
SECONDS, ASIDE = 70.0, 0.8  # s; m from the curve to the walls
SEES = TEAM.sensing_radius + 0.3  # m: the proof's, and how far a car is from its place in the mean


def hall(folder, curve=TEAM.curve, cell=0.05):
    """The map of a hall about the curve, with cabinets along its walls."""
    half = np.array([curve.B, curve.A]) + ASIDE
    rows, columns = np.ceil(2.0 * half / cell).astype(int)
    walls = np.ones((rows, columns), dtype=bool)
    walls[1:-1, 1:-1] = False
    rng = np.random.default_rng(4)
    for at in rng.integers(5, columns - 20, columns // 25):
        deep, wide = rng.integers(2, 6), rng.integers(5, 15)
        walls[(slice(0, deep) if rng.random() < 0.5 else slice(-deep, None)), at:at + wide] = True
    file = Path(folder) / "hall.yaml"
    write_grid(Grid(walls, ~walls, cell, -half[::-1]), file)
    return file


def starts(formation=TEAM, noise=0.3, seed=1):
    """A pose "X,Y,YAW" for each car: beside its slot by up to ``noise`` rad of the curve."""
    rng, course = np.random.default_rng(seed), Course(formation.curve)
    places = [course.point_at(float(X)) for X in
              formation.slots() + rng.uniform(-noise, noise, formation.n)]
    return [f"{p.x:.4f},{p.y:.4f},{p.heading:.4f}" for p in places]


def urls(places, seed=1, options="nano=mock&mocap=1"):
    """One emulated car of a room at each place."""
    return [f"sim://?seed={seed + n}&{options}&world=monitoring&at={place}"
            for n, place in enumerate(places)]


def drive(where, formation=TEAM, omega=OMEGA, coupling=COUPLING, room=ROOM, seconds=SECONDS,
          each=lambda fleet, team: None, guard=True, **opened):
    """(rows (k, n, 3) of x, y [m], X [rad] at 20 Hz since all cars move, monitors, contacts)."""
    rows = []
    with Fleet.open(where, room=room, **opened) as fleet:
        team = [Monitor(formation, fleet.names, name, plant_of(car.files), omega, coupling,
                        guard=guard) for name, car in zip(fleet.names, fleet.cars, strict=True)]
        fleet.arm()
        for tick, states in enumerate(fleet.states(duration=seconds)):
            for car, member, robot, state in zip(fleet.cars, fleet.members, team, states,
                                                 strict=True):
                motion = state.estimate.predict(car.now)
                told = {name: other.plan for name, other in member.other_poses().items()
                        if other.plan is not None and other.plan.frame == motion.frame}
                steering, speed = robot.answer(motion, told)
                member.tell_plan(robot.plan(), step=PLAN_STEP, frame=motion.frame)
                car.drive_speed(steering=steering, speed=speed)
            each(fleet, team)
            if tick % 5 == 0:
                rows.append([(s.estimate.pose.x, s.estimate.pose.y, robot.X)
                             for s, robot in zip(states, team, strict=True)])
        return np.array(rows), team, fleet.contacts


def draw(rows, picture):
    """Ways and discs at the end; disagreement, share that is seen, and where a target may hide."""
    plt = pyplot()
    t = 0.05 * np.arange(len(rows))
    hides = np.array([h.mean() for h in hidden_regions(TEAM.curve, rows[:, :, :2], SEES, 61)])
    now, _ = coverage(TEAM.curve, rows[:, :, :2], SEES, 61)
    figure, (floor, lines) = plt.subplots(1, 2, figsize=(10, 6.2), width_ratios=(1.0, 1.5),
                                          layout="constrained")
    scene(floor, rows, len(rows) - 1, None)
    lines.semilogy(t, [disagreement(X, TEAM.p) for X in rows[:, :, 2]], "k",
                   label="largest error of a phase to a neighbour [rad]")
    lines.plot(t, np.maximum(now, 1e-4), color="#0072b2", label="share of the area that is seen")
    lines.plot(t, np.where(hides > 0.0, hides, np.nan), color="#d55e00",
               label="share where a target may be that nobody saw yet")
    lines.axvspan(0.0, TEAM.bound(OMEGA), color="k", alpha=0.08, lw=0.0)
    lines.text(0.5 * TEAM.bound(OMEGA), 1.2e-3, f"bound: {TEAM.bound(OMEGA):.1f} s", fontsize=8)
    lines.set(xlabel="t [s]", ylim=(1e-3, 4.0))
    lines.legend(fontsize=8, loc="upper right")
    lines.grid(alpha=0.3)
    figure.savefig(picture, dpi=100)


def animate(rows, file, every=10, seconds=40.0, fps=10):
    """The drive, with what is left to hide in."""
    plt = pyplot()
    from matplotlib.animation import FuncAnimation, PillowWriter

    figure, floor = plt.subplots(figsize=(3.6, 6.2), layout="constrained")
    rows = rows[:round(20.0 * seconds)]
    hides = list(hidden_regions(TEAM.curve, rows[:, :, :2], SEES, 61))
    FuncAnimation(figure, lambda k: scene(floor, rows, every * k, hides[every * k]),
                  frames=len(rows) // every).save(file, PillowWriter(fps), dpi=60)


def scene(floor, rows, k, hides):
    """Curve, cars, what they see, and where a target may be, at row k."""
    from matplotlib.patches import Circle

    floor.clear()
    A, B = TEAM.curve.A, TEAM.curve.B
    if hides is not None:
        floor.imshow(np.where(hides, 1.0, np.nan), extent=(-A, A, -B, B), origin="lower",
                     cmap="autumn", alpha=0.5, vmin=0.0, vmax=2.0)
    way = TEAM.curve.position(np.linspace(0.0, 2.0 * np.pi, 600))
    floor.plot(*way.T, color="0.6", lw=0.8)
    for n, (x, y, _) in enumerate(rows[k]):
        colour = f"C{n}"
        floor.plot(*rows[max(k - 60, 0):k + 1, n, :2].T, color=colour, lw=2.0)
        floor.plot(x, y, "o", color=colour, ms=6)
        floor.add_patch(Circle((x, y), SEES, color=colour, alpha=0.08))
    floor.plot([-A, A, A, -A, -A], [-B, -B, B, B, -B], "k", lw=0.8)
    floor.set(xlim=(-1.15 * A, 1.15 * A), ylim=(-1.08 * B, 1.08 * B), aspect="equal",
              xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"t = {0.05 * k:.1f} s, sees {SEES:.1f} m", loc="left", fontsize=9)


def pyplot():
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    return plt


def main(picture=None, animation=None):
    """(rows, monitors, contacts) of the drive by lidar."""
    with tempfile.TemporaryDirectory() as folder:
        chart, places = hall(folder), starts()
        rows, team, contacts = drive(urls(places, options=f"nano=mock&lidar=1&map={chart}"),
                                     poses=[f"lidar:{chart}?start={at}" for at in places])
    for name, robot in zip(team[0].names, team, strict=True):
        told = ", ".join(f"{mode} {0.01 * n:.1f} s" for mode, n in robot.answers.items())
        print(f"{name}: {told}; beside the curve by {100 * robot.max_offset:.1f} cm at the most")
    print(f"{len(contacts)} contacts; phases within {disagreement(rows[-1, :, 2], TEAM.p):.3f} rad")
    if picture:
        draw(rows, picture)
    if animation:
        animate(rows, animation)
    return rows, team, contacts


if __name__ == "__main__":
    main(*sys.argv[1:])
