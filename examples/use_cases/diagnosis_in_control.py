"""Measure the benefit of a diagnosis in control: one controller, one car, three models of it.

The emulated car has a lag of its steering and one of its throttle that its model does not know. Two
recorded drives show them and `diagnose` names both: steps of the steering, and eights under steps
of the throttle. Then contouring control follows the 22.92 m track three times: by the paper's
model, by the car's own without the lags, and by that extended with what was found.

    python examples/use_cases/diagnosis_in_control.py [picture.png]
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from dart_hal import (
    PAPER,
    UPSTREAM_2024,
    Car,
    Delay,
    Follower,
    Phase,
    PurePursuit,
    Rules,
    figure_of_eight,
    model_of,
    plant_of,
    read_run,
    save_model,
    track_named,
)
from dart_lab import Floor, apply, check_inputs, conduct, diagnose, make_plan

PULSE = 0.013  # s from a command to the pulse that carries it, in the mean
KNOWN = replace(UPSTREAM_2024, name="known", delay=Delay(PULSE, PULSE))  # all but its lags
HIDDEN = {"steering_lag": 0.12, "throttle_lag": 0.08}  # s
EIGHTS, RADIUS, LOOK_AHEAD = 60.0, 0.9, 0.35  # s; m; m
THROTTLE, HOLD = (0.34, 0.20), 0.6  # 0.9 to 1.5 m/s; s each
SPEED, LAPS, LOST = 2.0, 2.0, 1.0  # m/s; -; m beside the path: the end of a drive
TRACK = track_named("racetrack_vicon_2")


def url(folder):
    """The car: the later published set, and what is hidden in it."""
    true = Path(folder) / "true.toml"
    car = replace(KNOWN, delay=Delay())
    for effect, k in HIDDEN.items():
        car = apply(car, effect, k=k)
    save_model(model_of(car), true)
    return f"sim://?nano=mock&mocap=1&vehicle={true}"


def found_of(where, folder):
    """The diagnosis of two recorded drives."""
    runs = [Path(folder) / f"{kind}.mcap" for kind in ("steps", "eights")]
    with Car.open(where, record=runs[0]) as car:
        conduct(car, make_plan("steps", car.files, Floor.parse("10"), None))
    with Car.open(where, record=runs[1]) as car:
        pursuit = PurePursuit(figure_of_eight(RADIUS), KNOWN.body.wheelbase, LOOK_AHEAD, 0.0)
        car.arm()
        begun = car.now
        for s in car.states(duration=EIGHTS):
            car.drive(steering=pursuit.steer(s.pose, s.speed, s.yaw_rate or 0.0),
                      throttle=THROTTLE[int((car.now - begun) / HOLD) % 2])
    sides = check_inputs([read_run(run) for run in runs], [], KNOWN)
    return diagnose(Path("known"), KNOWN, sides.train, sides.test, refit=False, max_causes=2)


def drive(where, folder, model):
    """Rows (x, y, offset [m], way [m]) by the motion capture, and why the drive ended."""
    with Car.open(where) as car:
        name = car.files.config.name
    cars = Path(folder) / model.name
    (cars / name).mkdir(parents=True)
    save_model(model_of(replace(model, name=name)), cars / name / "model.toml")
    with Car.open(where, cars=cars) as car:
        follower = Follower(TRACK, plant_of(car.files), SPEED, "mpcc",
                            Rules(LAPS, duration=60.0, lane=LOST, here=True))
        car.arm()
        for state in car.states(duration=90.0):
            steering, speed = follower.answer(state.estimate.predict(car.now))
            if follower.phase is Phase.ENDED:
                break
            car.drive_speed(steering=steering, speed=speed)
    table = follower.driven.table
    return table[:, [1, 2, 3, 6]], follower


def draw(drives, file):
    """Lines and errors of the three drives."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 4.4), width_ratios=(1.0, 1.4),
                                        layout="constrained")
    for (name, (rows, follower)), colour in zip(drives.items(), ("#d55e00", "#e69f00", "#0072b2"),
                                                strict=True):
        lap = rows[second(rows, follower)]
        floor.plot(lap[:, 0], lap[:, 1], color=colour, lw=1.0)
        along = lap[:, 3] - follower.begun_at - TRACK.length
        way.plot(along, 100.0 * lap[:, 2], color=colour, lw=1.1,
                 label=f"{name}: {100.0 * rms(rows, follower)[0]:.1f} cm rms")
        path = follower.path
    floor.plot(np.append(path.x, path.x[:1]), np.append(path.y, path.y[:1]), "k--", lw=0.9)
    floor.set_aspect("equal")
    floor.set(xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"contouring control, {SPEED:g} m/s; hidden: lags of steering and throttle",
                    loc="left", fontsize=9)
    way.set(xlabel="way along the path [m]", ylabel="rear axle left of the path [cm]")
    way.set_ylim(top=1.5 * way.get_ylim()[1])
    way.legend(fontsize=8, loc="upper right")
    for axes in (floor, way):
        axes.grid(alpha=0.3)
    figure.savefig(file, dpi=100)


def second(rows, follower):
    """Which rows are of the second lap; in the first the room finds where the marker sits."""
    return rows[:, 3] > follower.begun_at + TRACK.length


def rms(rows, follower):
    """(root mean square, largest) offset [m] in the second lap."""
    offset = rows[second(rows, follower), 2]
    return float(np.sqrt(np.mean(offset**2))), float(np.abs(offset).max())


def main(picture=None):
    """{model: (rms, largest) offset [m]}, and what was found."""
    with tempfile.TemporaryDirectory() as folder:
        where = url(folder)
        found = found_of(where, folder)
        for effect, k in ((c.effect, k) for c in found.causes for k in c.parameters.values()):
            print(f"found {effect} {k.value:.3g} +- {k.std:.1g} {k.unit}", flush=True)
        models = {"the paper's model": replace(PAPER, name="paper"),
                  "the car's, without its lags": KNOWN,
                  "extended by diagnose": replace(found.extended, name="extended")}
        drives = {name: drive(where, folder, model) for name, model in models.items()}
    for name, (rows, follower) in drives.items():
        error, most = rms(rows, follower)
        print(f"{name:30s} {100 * error:5.1f} cm rms, {100 * most:5.1f} at most; "
              f"lap of {follower.driven.lap_times[-1]:.2f} s")
    if picture:
        draw(drives, picture)
    return found, {name: rms(*of) for name, of in drives.items()}


if __name__ == "__main__":
    main(*sys.argv[1:])
