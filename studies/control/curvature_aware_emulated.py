"""MPCC beside CA-MPCC on emulated cars around the later published set, by their lidars' poses.

    python -m studies.control.curvature_aware_emulated --seeds 6 [--first 1] [--laps 2] [--speed 2]
        [--poses lidar|mocap] [--weights tuned] [--law ca-mpcc]
        [--published]

What the car's files know is the truth with the errors of calibrations and of an identification, as
in ``follow_figures``. The error is that of the true rear axle beside the path in the room, that of
the localisation included. --published: the controller's own model, kinematic and without lags. Some
15 s of CPU a drive.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from functools import partial
from math import cos, sin
from pathlib import Path

import numpy as np

from dart_hal.car import Car
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.curvature_aware.two_layers import TwoLayers
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.mpc.tracker import DEFAULT_HALF_WIDTH, Contouring
from dart_hal.control.plant import plant_of
from dart_hal.control.trackers import Lqr, without_delay
from dart_hal.core.config import save_model
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.vehicle.file import model_of
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import room_of_car, world_of
from studies.control.curvature_aware_loop import BEHIND, TRACK, WEIGHTS, Found, left_lane
from studies.control.follow_figures import later, write_files


class Watched(TwoLayers):
    """Keeps the progress error of each plan in ``errors``."""

    def __init__(self, *args, **options):
        super().__init__(*args, **options)
        self.errors = []

    def plan(self, *args):
        plan = super().plan(*args)
        self.errors.append(plan.way.error(self.reference, plan.s[0]))
        return plan


def watched(path, plant, **options):
    return Contouring(
        path, plant, Lqr(path, plant), partial(Watched, **options), lane=DEFAULT_HALF_WIDTH
    )


def drive(seed: int, law, weights, *, speed: float = 2.0, laps: float = 2.0,
          poses: str = "lidar", published: bool = False) -> tuple[Found, Follower]:
    """From rest at the start of the track, in its room between boards."""
    with tempfile.TemporaryDirectory() as folder:
        true = Path(folder) / "true.toml"
        save_model(model_of(later(seed)), true)
        url = f"sim://?seed={seed}&nano=mock&vehicle={true}"
        write_files(f"{url}&mocap=1", seed, Path(folder))
        by_lidar = poses == "lidar"
        backend = open_backend(url + ("&lidar=1&map=track" if by_lidar else "&mocap=1"))
        if by_lidar:
            room = room_of_car(backend)
            x0, y0, yaw0 = room.start
            source = LidarPoses(map_of_lines(room.lines), room.start)
        else:
            hidden, source = hidden_mocap(seed), None
            x0, y0, yaw0 = hidden.x, hidden.y, hidden.yaw
        with Car.over(backend, cars=folder, **({"poses": source} if source else {})) as car:
            plant = plant_of(car.files)
            known = plant
            if published:
                known = without_delay(replace(plant, vehicle=replace(plant.vehicle,
                                                                     kind="kinematic")))
            follower = Follower(TRACK, known, speed,
                                partial(watched, law=law, path_weights=weights),
                                Rules(laps=laps, lane=1.0, duration=40.0 * laps,
                                      here=not by_lidar))
            rows = driven(car, follower, (x0, y0, yaw0), world_of(backend))
    return found_of(follower, np.array(rows), laps), follower


def driven(car, follower, start, world) -> list[tuple[float, ...]]:
    """Rows t, true x, y in the room."""
    x0, y0, yaw0 = start
    c, s, rows, armed = cos(yaw0), sin(yaw0), [], False
    for state in car.states(duration=150.0):
        steering, wanted = follower.answer(state.estimate.predict(car.now))
        if follower.phase in (Phase.STOPPING, Phase.ENDED):
            break
        if follower.phase is Phase.WAITING:
            continue
        if not armed:
            car.arm()
            armed = True
        car.drive_speed(steering=steering, speed=wanted)
        true = world.truth()
        rows.append((true.t, x0 + c * true.x - s * true.y, y0 + s * true.x + c * true.y))
    return rows


def found_of(follower, rows, laps) -> Found:
    path, s, table = follower.path, follower.begun_at, []
    for t, x, y in rows:
        s = path.closest(x, y, s)
        table.append((t, s - follower.begun_at, path.offset(x, y, s)))
    times, way, error = np.array(table).T
    t, on = times[way > BEHIND], way[way > BEHIND]
    counted, plans = error[way > BEHIND], np.array(follower.tracker.mpcc.errors)
    whole = follower.why == "the path is driven"
    pace = (t[-1] - t[0]) / (on[-1] - on[0])
    return Found(float(np.sqrt(np.mean(plans[:, -1] ** 2))), float(np.sqrt(np.mean(plans**2))),
                 float(np.sqrt(np.mean(counted**2))), float(np.abs(counted).max()),
                 left_lane(counted), float(pace) * path.length if whole else np.nan,
                 float(way[-1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--laps", type=float, default=2.0)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--poses", choices=("lidar", "mocap"), default="lidar")
    parser.add_argument("--weights", choices=tuple(WEIGHTS), nargs="*", default=tuple(WEIGHTS))
    parser.add_argument("--law", type=Law, choices=tuple(Law), nargs="*", default=tuple(Law))
    parser.add_argument("--published", action="store_true")
    given = parser.parse_args()
    for name in given.weights:
        weights = WEIGHTS[name]
        for law in given.law:
            all_ = []
            for seed in range(given.first, given.first + given.seeds):
                found, follower = drive(seed, law, weights, speed=given.speed, laps=given.laps,
                                        poses=given.poses, published=given.published)
                all_.append(found)
                told = {str(k): n for k, n in follower.tracker.mpcc.outcomes.items() if n}
                print(f"  {name:9s} {law.value:7s} car {seed}: {found}; {follower.why}; {told}",
                      flush=True)
            rms, most = 100.0 * np.array([f.rms for f in all_]), max(f.most for f in all_)
            print(f"{name} {law}, {len(all_)} cars: plan "
                  f"{np.mean([100.0 * f.plan_end for f in all_]):.2f} cm at its end; car rms mean "
                  f"{rms.mean():.2f}, worst {rms.max():.2f}, most {100.0 * most:.1f} cm; left "
                  f"{sum(f.left for f in all_)}; lap {np.mean([f.lap for f in all_]):.2f} s",
                  flush=True)


if __name__ == "__main__":
    main()
