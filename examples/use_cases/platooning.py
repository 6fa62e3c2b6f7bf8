"""Platooning with on-board localisation: five cars on a long straight, one of which lies.

Each car knows where it is by its lidar in a map, how far the next one is by its lidar, and what the
next one tells over the room: speed and acceleration, of which three in ten messages are lost. After
5 s the second car tells accelerations that it does not drive. After 13 s the first one brakes to
rest. The rule behind the controller keeps the cars apart, and a detector finds the lie; the
published controller, driven the same way, ends in contact.

    python examples/use_cases/platooning.py [picture.png [animation.gif]]

On real cars: Fleet.open(["serial:///dev/ttyUSB0?i2c=auto", ...], car=[...],
poses=["lidar:map.yaml?start=X,Y,YAW", ...], room="udp://239.255.42.99:7447"), one program for all;
or `drive` of one car in a program of its own, as examples/two_cars.py.
"""

import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dart_hal import Fleet, plant_of
from dart_hal import Path as Track
from dart_hal.control.platoon.car import PlatoonCar, PredecessorState
from dart_hal.control.platoon.follower import PlatoonFollower
from dart_hal.control.platoon.gains import DART, STABLE
from dart_hal.control.platoon.laws import leader
from dart_hal.control.platoon.safe import SafetyMargins

CARS, APART, LOSS = 5, 0.8, 0.3  # -; m from rear axle to rear axle at the start; share of messages
LONG, WIDE, CELL = 26.0, 2.4, 0.05  # m of the corridor, of its map
LIES, BRAKES, LASTS = 5.0, 13.0, 16.0  # s from the start
LIE = 1000.0  # m/s2 that the second car tells
CAREFUL = SafetyMargins(
    b_s=0.9, b_p=1.4, e_g=0.05, e_v=0.05, m=0.03
)  # at neutral a car loses 1.2 m/s2
EVERY = 5  # States from one plan that is told to the next
WAIVED = ("CALIBRATION_MISSING",)  # of emulated cars as they come


@dataclass
class Drive:
    """rows: t [s], car, x, y [m] of the rear axle, speed [m/s], acceleration asked for [m/s2],
    gap [m] as the follower knows it, offset from the path [m], mode. ``cars``, ``contacts``."""

    rows: list = field(default_factory=list)
    cars: list = field(default_factory=list)
    contacts: tuple = ()

    @property
    def touching(self):
        """Pairs of cars."""
        return {frozenset(contact.cars) for contact in self.contacts}

    def of(self, car):
        """Columns of one car."""
        columns = list(zip(*(row for row in self.rows if row[1] == car), strict=True))
        return [np.array(column) for column in columns]


def corridor(folder, length=LONG):
    """The map of a corridor with things along its walls, as ROS's map_server keeps it."""
    rows, columns = round(WIDE / CELL), round(length / CELL)
    grey, rng = np.full((rows, columns), 254, np.uint8), np.random.default_rng(1)
    grey[:2] = grey[-2:] = grey[:, :2] = grey[:, -2:] = 0
    for x in np.arange(1.0, length - 1.0, 1.5):
        begin, deep = int((x + rng.uniform(0.0, 0.8)) / CELL), round(0.25 / CELL)
        end = begin + int(rng.uniform(0.2, 0.6) / CELL)
        grey[slice(0, deep) if rng.random() < 0.5 else slice(-deep, None), begin:end] = 0
    (Path(folder) / "corridor.pgm").write_bytes(b"P5 %d %d 255\n" % (columns, rows)
                                                + grey[::-1].tobytes())
    file = Path(folder) / "corridor.yaml"
    file.write_text(f"image: corridor.pgm\nresolution: {CELL}\norigin: [0.0, {-WIDE / 2}, 0.0]\n"
                    "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n")
    return file


def starts(path, cars=CARS, first=5.0):
    """x, y, yaw of the rear axles, the leader's first."""
    spots = [path.interpolate(first - APART * n) for n in range(cars)]
    return [f"{spot.x:.4f},{spot.y:.4f},{spot.heading:.4f}" for spot in spots]


def urls_of(chart, places, seeds, lidar="1"):
    """Emulated cars in one world."""
    return [f"sim://?nano=mock&seed={seed}&world=platoon&at={at}&lidar={lidar}&map={chart}"
            for seed, at in zip(seeds, places, strict=True)]


def ahead_of(others, name, now):
    """What the predecessor told, None: nothing yet. Its plan begins with where it was."""
    other = others.get(name)
    if other is None or other.plan is None or len(other.plan.points) < 2:
        return None
    (x, y, _, speed), (_, _, _, then) = other.plan.points[:2].tolist()
    return PredecessorState(now - other.plan.age, x, y, speed, (then - speed) / other.plan.step)


def drive(
    urls,
    path,
    *,
    poses,
    lasts=LASTS,
    loss=LOSS,
    brakes=BRAKES,
    lies=None,
    make=PlatoonFollower,
    gains=STABLE,
    waive=WAIVED,
    silent=(),
    each=None,
    record=None,
    cars=None,
    see=None,
    tracker="lqr",
):
    """One drive of a platoon, the first URL leads.

    lies: {car: of t [s], what it tells as its acceleration, None: the truth}; silent: cars that
    tell nothing; make: a follower; each(fleet, t, cars): at each tick; see(car, motion): what is
    known of the own motion instead; tracker: "pursuit" steers as published, "lane" by boards.
    """
    drive, lies = Drive(), lies or {}
    with Fleet.open(urls, poses=poses, room=f"local://platoon?loss={loss}&seed=1", record=record,
                    cars=cars) as fleet:
        begun = []

        def lead(t, speed):
            return gains.u_min if t - begun[0] >= brakes else leader(gains, speed)

        drive.cars = [PlatoonCar(path, plant_of(car.files), make() if n else None, gains=gains,
                                 tracker=tracker, drives=None if n else lead)
                      for n, car in enumerate(fleet.cars)]
        fleet.arm(waive=waive)
        begun += [car.now for car in fleet.cars]
        for tick, states in enumerate(fleet.states(duration=lasts)):
            for n, (car, state, one) in enumerate(zip(fleet.cars, states, drive.cars,
                                                      strict=True)):
                motion = state.estimate.predict(car.now)
                motion = see(n, motion) if see else motion
                t = car.now - begun[n]
                told = ahead_of(fleet.other_poses(fleet.names[n]), fleet.names[n - 1],
                                car.now) if n else None
                steering, speed = one.answer(motion, car.lidar.scans(), told)
                if tick % EVERY == 0 and n not in silent:
                    plan = one.plan(motion, lies[n](t) if n in lies else None)
                    fleet.members[n].tell_plan(plan, step=0.05, frame=motion.frame)
                    car.log("platoon", {"u": one.u, "mode": list(type(one.mode)).index(one.mode)})
                car.drive_speed(steering=steering, speed=speed)
                gap = one.follower.gap if n else np.nan
                drive.rows.append((t, n, motion.pose.x, motion.pose.y, motion.speed, one.u, gap,
                                   one.offset, str(one.mode)))
            if each:
                each(fleet, t, drive.cars)
        drive.contacts = fleet.contacts
    return drive


def lie(t):
    """What the second car tells of its acceleration [m/s2], None: the truth."""
    return LIE if t >= LIES else None


def straight(folder, seeds=range(1, CARS + 1), hall=corridor, **how):
    """The drive down the corridor; hall(folder): its map."""
    path = Track([(LONG - 1.5, 0.0)], closed=False, start=(0.5, 0.0, 0.0))
    chart, places = hall(folder), starts(path, len(seeds))
    poses = [f"lidar:{chart}?start={at}" for at in places]
    return drive(urls_of(chart, places, seeds), path, poses=poses, **how)


def careful():
    """The rule behind it, string-stable gains, and the detector."""
    return PlatoonFollower(STABLE, margins=CAREFUL)


def published():
    """As published: alpha 0.95, nothing behind it."""
    return PlatoonFollower(DART, rule=False, compensated=False, detects=False)


def draw(drives, file):
    """Gaps of both drives over time, speeds and modes of the first."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    colours = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
    figure, panels = plt.subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
    for panel, (name, one) in zip(panels[:2], drives.items(), strict=True):
        for n in range(1, CARS):
            t, _, x, _, _, _, _, _, mode = one.of(n)
            gap = one.of(n - 1)[2] - x - 0.3
            acc = mode == "ACC"
            panel.plot(t, gap, color=colours[n], lw=1.2, label=f"car {n + 1} behind car {n}")
            panel.plot(t[acc], gap[acc], ".", color=colours[n], ms=4)
        panel.axhline(0.0, color="k", lw=0.8)
        panel.set_title(f"{name}; pairs of cars that touch: {len(one.touching)}", loc="left",
                        fontsize=9)
        panel.set_ylabel("net gap [m]")
        panel.set_ylim(-0.1, 1.0)
        panel.legend(fontsize=7, ncols=4, loc="upper left")
    for n in range(CARS):
        t, _, _, _, speed, _, _, _, _ = next(iter(drives.values())).of(n)
        panels[2].plot(t, speed, color=colours[n], lw=1.0, label=f"car {n + 1}")
    panels[2].set(xlabel="time [s]", ylabel="speed [m/s]")
    panels[2].legend(fontsize=7, ncols=5, loc="lower left")
    for panel in panels:
        panel.grid(alpha=0.3)
        for when in (LIES, BRAKES):
            panel.axvline(when, color="0.5", lw=0.8, ls="--")
    figure.savefig(file, dpi=100)
    plt.close(figure)


def animate(drives, file, fps=10):
    """Both platoons from above, at the rate at which they drove."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import animation
    from matplotlib import pyplot as plt
    from matplotlib.patches import Rectangle

    figure, panels = plt.subplots(len(drives), 1, figsize=(8, 2.4), layout="constrained")
    ways = {name: [one.of(n) for n in range(CARS)] for name, one in drives.items()}
    bodies = []
    for panel, name in zip(panels, ways, strict=True):
        panel.set(ylim=(-0.4, 0.4), yticks=[], aspect="equal")
        panel.set_title(name, loc="left", fontsize=8)
        bodies.append([panel.add_patch(Rectangle((0, 0), 0.3, 0.19, color="#0072b2"))
                       for _ in range(CARS)])
    shade = {"LEAD": "#22313f", "CACC": "#0072b2", "ACC": "#e69f00", "STOP": "#d55e00"}

    def frame(k):
        for panel, name, boxes in zip(panels, ways, bodies, strict=True):
            lead = ways[name][0]
            row = min(k * 100 // fps, len(lead[0]) - 1)
            panel.set_xlim(lead[2][row] - 5.0, lead[2][row] + 1.0)
            for body, way in zip(boxes, ways[name], strict=True):
                body.set_xy((way[2][row] - 0.0625, way[3][row] - 0.095))
                body.set_color(shade[way[8][row]])
        return [body for boxes in bodies for body in boxes]

    panels[-1].set_xlabel("along the corridor [m]", fontsize=8)
    frames = int(min(len(way[0][0]) for way in ways.values()) * fps / 100)
    animation.FuncAnimation(figure, frame, frames).save(file, writer=animation.PillowWriter(fps),
                                                        dpi=70)
    plt.close(figure)


def main(picture=None, film=None):
    """{what drives: its ``Drive``}."""
    drives = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, make, gains in (("safe rule and detector", careful, STABLE),
                                  ("as published, alpha 0.95", published, DART)):
            drives[name] = one = straight(folder, make=make, gains=gains, lies={1: lie})
            least = min(np.nanmin(one.of(n - 1)[2] - one.of(n)[2]) - 0.3 for n in range(1, CARS))
            print(f"{name}: {len(one.touching)} pairs touch, least net gap {100 * least:.0f} cm by "
                  f"the cars' own poses; lateral rms "
                  f"{100 * np.sqrt(np.mean([row[7] ** 2 for row in one.rows])):.1f} cm", flush=True)
            for n, car in enumerate(one.cars[1:], 2):
                counts, heard = car.follower.counts, car.follower.hearing.counts
                print(f"  car {n}: {dict(counts)}, messages {dict(heard)}"
                      + (", found the lie" if car.follower.detector.attacked else ""), flush=True)
    if picture:
        draw(drives, picture)
    if film:
        animate(drives, film)
    return drives


if __name__ == "__main__":
    main(*sys.argv[1:])
