"""How closely paths are followed on hidden cars, by their true rear axle.

    python -m studies.control.follow_figures --seeds 10 --speed 1 2 [--car later] [--tracker lqr]
        [--track racetrack_vicon_2] [--raceline 0.3] [--laps 3] [--blind] [--lidar] [--plot PNG]
    python -m studies.control.follow_figures --first 21 --speed 2 --plot docs/pictures/following.png

car "paper": the hidden cars of ``sim://?seed=N``, whose front tyres end at 0.3 of their load: in
turns of 0.75 m they hold 1.4 m/s. car "later": the later published set, drawn around as the seeds
draw the paper's, with its steering lag of 0.13 s: it holds 2.0 m/s there. What the car's files
know is the truth with the errors of calibrations and of an identification. speed 0: the profile's.
--blind: without delay compensation. --lidar: the pose by the car's own lidar in the map of a hall
around that track, instead of motion capture. --plot: the first car and speed, by both trackers and
blind.
--raceline: bends cut by up to so many m, by each car's own model.
--lines: no drive, but what laps the profile has on the middle and on racelines. Some 10 s a car and
lap.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, replace
from math import cos, inf, sin
from pathlib import Path

import numpy as np
from msgspec.structs import replace as replace_table

from dart_hal.car import Car
from dart_hal.control.follow import DEFAULT_MAX_SPEED, Follower, Phase, Rules
from dart_hal.control.lap import speed_profile
from dart_hal.control.plant import Plant, SteeringDelay, plant_of
from dart_hal.control.raceline import raceline
from dart_hal.control.trackers import TRACKERS, Make, without_delay
from dart_hal.control.tracks import track_named
from dart_hal.core.config import (
    Calibration,
    Quantities,
    Quantity,
    SteeringTable,
    save_calibration,
    save_model,
)
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.parameters import AxleTyres, Delay, Vehicle
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from dart_hal.vehicle.steering import make_steering
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import reveal_url, room_of_car, world_of

FORCES, TYRES, DRAG, LATE_STD, MAP_STD = 0.02, 0.05, 0.1, 0.003, 0.0045
"""Relative errors of an identification; s of its delays; rad of a point of the steering map."""
STDS = {"throttle.neutral_us": 1.0, "encoder.metres_per_edge": 1.2e-6, "imu.gyro_bias": 9e-5,
        "imu.gyro_scale": 3.3e-4, "imu.mount_yaw": 1e-3, "imu.mount_pitch": 5e-5,
        "imu.mount_roll": 5e-5, "mocap.marker_x": 1.2e-4, "mocap.marker_y": 5e-5,
        "mocap.marker_yaw": 1e-4, "mocap.latency": 1.9e-3}
"""Standard errors that the calibrations state on car 1."""
LIDAR_STDS = {"lidar.mount_x": 3e-4, "lidar.mount_y": 1.5e-4, "lidar.mount_yaw": 3e-4,
              "lidar.scale": 5e-5}
"""The same of how the lidar sits."""
POINTS = 13
"""Of the steering map."""


def later(seed: int) -> Vehicle:
    """A car around the later published set, as the seeds draw cars around the paper's."""
    rng, p = np.random.default_rng([seed, 700]), UPSTREAM_2024

    def near(value: float, part: float) -> float:
        return value * float(rng.uniform(1.0 - part, 1.0 + part))

    assert isinstance(p.tyres, AxleTyres)
    map_ = replace(p.steering, **{key: near(getattr(p.steering, key), 0.05) for key in (
        "k_left", "a_left_rad", "a_right_rad", "k_right")})
    tyres = replace(p.tyres, **{key: near(getattr(p.tyres, key), 0.05) for key in (
        "front_D", "front_B", "rear_D", "rear_B")})
    delay = replace(p.delay, steering_s=float(rng.uniform(0.005, 0.03)),
                    steering_lag_s=near(p.delay.steering_lag_s, 0.1),
                    throttle_lag_s=near(p.delay.throttle_lag_s, 0.1))
    return replace(p, name=f"later-{seed}", body=replace(p.body, mass=near(p.body.mass, 0.03)),
                   steering=map_, tyres=tyres, delay=delay)


def identified(url: str, seed: int) -> Vehicle:
    """What an identification would find."""
    backend = open_backend(url)
    car = world_of(backend).car
    backend.close()
    p, span, rng = car.vehicle, 450.0 / car.esc.saturation_us, np.random.default_rng([seed, 77])

    def near(value: float, part: float) -> float:
        return value * (1.0 + part * float(rng.normal()))

    def late(value: float) -> float:
        return max(value + LATE_STD * float(rng.normal()), 0.0)

    names = [n for n in p.tyres.__dataclass_fields__ if n[-2:] in ("_D", "_B", "ss")]
    tyres = replace(p.tyres, **{n: near(getattr(p.tyres, n), TYRES) for n in names})
    motor = replace(p.motor, d=near(p.motor.d * span, FORCES), e=near(p.motor.e * span, FORCES),
                    g=p.motor.g / span)
    friction = replace(p.friction, a=near(p.friction.a, FORCES), c=near(p.friction.c, DRAG))
    delay = Delay(steering_s=late(car.servo.delay), steering_lag_s=late(car.servo.lag)
                  if car.servo.lag else 0.0, throttle_s=late(car.esc.delay),
                  throttle_lag_s=late(car.esc.lag))
    return replace(p, motor=motor, friction=friction, tyres=tyres, delay=delay)


def write_files(url: str, seed: int, cars: Path) -> None:
    """calibration.toml and model.toml of a hidden car."""
    backend = open_backend(url)
    world, shown = world_of(backend), reveal_url(backend.url)
    servo = world.car.servo
    with Car.over(backend, cars=cars) as car:
        name = car.files.config.name
    true, rng = shown["sensors"], np.random.default_rng([seed, 78])
    found: dict[str, Quantity | Quantities] = {
        key: Quantity(true[key] + std * float(error), std)
        for (key, std), error in zip(STDS.items(), rng.normal(size=len(STDS)), strict=True)
        if key in true}
    seen = np.random.default_rng([seed, 79])
    found |= {key: Quantity(true[key] + std * float(seen.normal()), std)
              for key, std in LIDAR_STDS.items() if key in true}
    found["encoder.ring"] = Quantities(tuple(true["encoder.ring"]), 2e-4)
    cal = Calibration(car=name).with_quantities(found)
    command, curve = np.linspace(-1.0, 1.0, POINTS), make_steering(servo.curve)
    angle = np.array([curve(s) for s in command]) + MAP_STD * rng.normal(size=POINTS)
    table = SteeringTable(pulse_us=tuple((servo.center_us + servo.span_us * command).tolist()),
                          angle_rad=tuple(angle.tolist()), std_rad=(MAP_STD,) * POINTS)
    steering = replace_table(cal.steering, map=table)
    save_calibration(replace_table(cal, steering=steering), cars / name)
    save_model(model_of(replace(identified(url, seed), name=name)), cars / name / "model.toml")


@dataclass(frozen=True)
class Drive:
    """t [s], arc length, true x, y [m], yaw in the room, lateral error [m], that of the centre of
    mass, true and wanted speed [m/s]; (n,) each; settled: the row from which on the figures are
    taken."""

    follower: Follower
    t: np.ndarray
    s: np.ndarray
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray
    error: np.ndarray
    middle: np.ndarray
    speed: np.ndarray
    wanted: np.ndarray
    settled: int

    @property
    def figures(self) -> dict[str, float]:
        """rms and largest error [m] after the first 3 m, the same of the centre of mass, flying lap
        against the profile's [-]."""
        error, middle = self.error[self.settled:], self.middle[self.settled:]
        laps = self.follower.driven.lap_times[1:]
        ratio = np.mean(laps) / self.follower.expected - 1.0 if laps else np.nan
        return {"rms": float(np.sqrt(np.mean(error**2))), "max": float(np.abs(error).max()),
                "com": float(np.sqrt(np.mean(middle**2))), "com max": float(np.abs(middle).max()),
                "lap": float(ratio)}


def driven(seed: int, speed: float, kind: str = "later", tracker: str | Make = "lqr",
           track: str = "racetrack_vicon_2", laps: float = 3.0, blind: bool = False,
           half_width: float | None = None, lidar: bool = False) -> Drive:
    """One drive of a hidden car from rest at the path's start."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sim://?seed={seed}&nano=mock&" + ("lidar=1&map=track" if lidar else "mocap=1")
        if kind == "later":
            true = Path(folder) / "true.toml"
            save_model(model_of(later(seed)), true)
            url += f"&vehicle={true}"
        write_files(url, seed, Path(folder))
        backend = open_backend(url)
        (room_x, room_y, room_yaw), source = floor_of(backend, seed, lidar)
        rows: list[tuple[float, ...]] = []
        with Car.over(backend, cars=folder, poses=source) as car:
            world = world_of(backend)
            plant = plant_of(car.files)
            path = track_named(track)
            if half_width is not None:
                path = raceline(path, half_width, plant, speed or DEFAULT_MAX_SPEED)
            follower = Follower(path, without_delay(plant) if blind else plant,
                                speed or inf, tracker,
                                Rules(laps=laps, here=not lidar, lane=1.0 if blind else 0.3,
                                      duration=120.0))
            for state in car.states(duration=150.0):
                steering, wanted = follower.answer(state.estimate.predict(car.now))
                if follower.phase in (Phase.STOPPING, Phase.ENDED):
                    break
                if follower.phase is Phase.WAITING:
                    continue
                if not rows:
                    car.arm()
                car.drive_speed(steering=steering, speed=wanted)
                true = world.truth()
                c, s = cos(room_yaw), sin(room_yaw)
                rows.append((true.t, room_x + c * true.x - s * true.y,
                             room_y + s * true.x + c * true.y, room_yaw + true.yaw, true.v_x,
                             wanted))
    t, x, y, yaw, v, w = np.array(rows).T
    path, s, error, middle, ways = follower.path, follower.begun_at, [], [], []
    ahead = plant.vehicle.body.l_r
    for px, py, turned in zip(x, y, yaw, strict=True):
        s = path.closest(px, py, s)
        error.append(path.offset(px, py, s))
        ways.append(s)
        mx, my = px + ahead * cos(turned), py + ahead * sin(turned)
        middle.append(path.offset(mx, my, path.closest(mx, my, s)))
    settled = int(np.argmax(np.array(ways) > follower.begun_at + 3.0))
    return Drive(follower, t, np.array(ways), x, y, yaw, np.array(error),
                 np.array(middle), v, w, settled)


def floor_of(backend: Backend, seed: int,
             lidar: bool) -> tuple[tuple[float, float, float], LidarPoses | None]:
    """Where the car began in the frame of its poses, and their source but for motion capture."""
    if not lidar:
        room = hidden_mocap(seed)
        return (room.x, room.y, room.yaw), None
    hall = room_of_car(backend)
    return hall.start, LidarPoses(map_of_lines(hall.lines), hall.start)


def lines(cap: float) -> None:
    """Laps by the profile of the two published sets, on the middle and on racelines."""
    for p in (PAPER, UPSTREAM_2024):
        curve = make_steering(p.steering)
        plant = Plant(p, SteeringDelay(0.0), (curve(-1.0), curve(1.0)))
        for name in ("racetrack_vicon_2", "savoiardo"):
            middle = track_named(name)
            laps = [speed_profile(path, plant, cap).time for path in (
                middle, *(raceline(middle, width, plant, cap) for width in (0.1, 0.2, 0.3)))]
            print(f"{p.name}, {name}, up to {cap:g} m/s: middle, within 0.1, 0.2, 0.3 m: "
                  + ", ".join(f"{lap:.2f}" for lap in laps) + " s")


def plot(seed: int, speed: float, kind: str, track: str, file: Path) -> None:
    """True lines and lateral errors of one car over its second lap."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (floor, way) = plt.subplots(1, 2, figsize=(11, 4.4), width_ratios=(1.0, 1.4),
                                        layout="constrained")
    for tracker, blind, colour, name in (
            ("pursuit", True, "#d55e00", "pursuit, no delay compensation"),
            ("pursuit", False, "#009e73", "pursuit"), ("lqr", False, "#0072b2", "lqr")):
        drive = driven(seed, speed, kind, tracker, track, 2.0, blind)
        path = drive.follower.path
        lap = drive.s - drive.follower.begun_at > path.length
        floor.plot(drive.x[lap], drive.y[lap], color=colour, lw=1.0)
        rms = 100.0 * np.sqrt(np.mean(drive.error[lap] ** 2))
        way.plot(drive.s[lap] - path.length, 100.0 * drive.error[lap], color=colour, lw=1.1,
                 label=f"{name}: {rms:.1f} cm rms")
    floor.plot(np.append(path.x, path.x[:1]), np.append(path.y, path.y[:1]), "k--", lw=0.9,
               label="path")
    floor.set_aspect("equal")
    floor.set(xlabel="x [m]", ylabel="y [m]")
    floor.set_title(f"{track}, {speed:g} m/s, hidden car {seed} ({kind})", loc="left", fontsize=9)
    way.set(xlabel="way along the path [m]", ylabel="true rear axle left of the path [cm]")
    way.set_ylim(top=1.5 * way.get_ylim()[1])
    for axes in (floor, way):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="center" if axes is floor else "upper right")
    figure.savefig(file, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--speed", type=float, nargs="*", default=[1.0, 2.0])
    parser.add_argument("--car", choices=("paper", "later"), default="later")
    parser.add_argument("--tracker", choices=tuple(TRACKERS), nargs="*", default=["lqr"])
    parser.add_argument("--track", default="racetrack_vicon_2")
    parser.add_argument("--laps", type=float, default=3.0)
    parser.add_argument("--raceline", type=float)
    parser.add_argument("--blind", action="store_true")
    parser.add_argument("--lidar", action="store_true")
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--lines", action="store_true")
    given = parser.parse_args()
    if given.lines:
        lines(5.0)
        return
    if given.plot:
        plot(given.first, given.speed[0], given.car, given.track, given.plot)
        return
    for tracker in given.tracker:
        for speed in given.speed:
            rows, ends = [], []
            for seed in range(given.first, given.first + given.seeds):
                drive = driven(seed, speed, given.car, tracker, given.track, given.laps,
                               given.blind, given.raceline, given.lidar)
                rows.append(drive.figures)
                ends.append(drive.follower.why)
                print(f"  {seed}: " + ", ".join(f"{name} {100.0 * value:.2f}" for name, value in
                                                rows[-1].items()), flush=True)
            print(f"{given.car}, {given.track}, {tracker}, {speed:g} m/s, {len(rows)} cars; "
                  f"{sum(why == 'the path is driven' for why in ends)} drove it all")
            for name in rows[0]:
                values = np.array([row[name] for row in rows]) * 100.0
                print(f"  {name:7s} mean {np.mean(values):.2f}, median {np.median(values):.2f}, "
                      f"worst {np.abs(values).max():.2f} {'%' if name == 'lap' else 'cm'}; "
                      + " ".join(f"{v:.1f}" for v in values), flush=True)
            print("  ", set(ends))


if __name__ == "__main__":
    main()
