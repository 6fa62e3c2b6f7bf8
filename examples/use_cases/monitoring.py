"""Persistent monitoring: cars spread over a Lissajous curve, and no target escapes them.

Emulated cars in one room, each with a program of its own state: it knows its place by its lidar (or
a motion capture), hears the phases of the others over a room that loses 30 % of the frames, and
drives by the time-inverted Kuramoto law. A target walks about in the area and avoids them.

    python examples/use_cases/monitoring.py [picture.png [animation.gif]]

On real cars: URLS of serial:// and ROOM of udp://, with `car=` names in `Fleet.open`, the rest is
the same (docs/use_cases/monitoring.md).
"""

import sys

import numpy as np

from dart_hal import Fleet
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.monitoring.monitor import Monitor
from dart_hal.control.monitoring.peer import STEP
from dart_hal.control.plant import plant_of

TEAM = Formation(Lissajous(3.3, 0.9, 1, 2), 3, 1)
OMEGA, COUPLING = 0.25, 0.25  # rad/s: of the formation; K / N
ROOM = "local://monitoring?loss=0.3&seed=1"
SECONDS = 60.0


def urls(formation=TEAM, noise=0.3, seed=1, options="nano=mock"):
    """One emulated car of a room for each slot, beside it by up to ``noise`` rad."""
    rng, course = np.random.default_rng(seed), Course(formation.curve)
    places = [course.spot(float(X)) for X in
              formation.slots() + rng.uniform(-noise, noise, formation.n)]
    return [f"sim://?{options}&seed={seed + n}&world=monitoring&at={p.x:.4f},{p.y:.4f},"
            f"{p.heading:.4f}&mocap=1"
            for n, p in enumerate(places)]


def drive(where, formation=TEAM, omega=OMEGA, coupling=COUPLING, room=ROOM, seconds=SECONDS,
          each=lambda t, monitors: None, **opened):
    """(rows (k, n, 3) of x, y [m], X [rad] at 20 Hz, the monitors, contacts)."""
    rows = []
    with Fleet.open(where, room=room, **opened) as fleet:
        team = [Monitor(formation, fleet.names, name, plant_of(car.files), omega, coupling)
                for name, car in zip(fleet.names, fleet.cars, strict=True)]
        fleet.arm()
        for tick, states in enumerate(fleet.states(duration=seconds)):
            for car, member, robot, state in zip(fleet.cars, fleet.members, team, states,
                                                 strict=True):
                told = {name: other.plan for name, other in member.other_poses().items()
                        if other.plan is not None}
                motion = state.estimate.at(car.now)
                steering, speed = robot.answer(motion, told)
                member.tell_plan(robot.plan(), step=STEP, frame=motion.frame)
                car.drive_speed(steering=steering, speed=speed)
            each(states[0].t, team)
            if tick % 5 == 0:
                rows.append([(s.estimate.pose.x, s.estimate.pose.y, robot.X)
                             for s, robot in zip(states, team, strict=True)])
        return np.array(rows), team, fleet.contacts


def main(picture=None, animation=None):
    rows, team, contacts = drive(urls())
    for robot in team:
        print(robot.mode, dict(robot.answers), robot.follower.why)
    print(len(contacts), "contacts")
    return rows, team, contacts


if __name__ == "__main__":
    main(*sys.argv[1:])
