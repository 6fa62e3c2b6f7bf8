"""CA-MPCC past a virtual obstacle on emulated cars of which nothing is known: the default model.

    python -m studies.control.curvature_aware_uncalibrated --seeds 12 [--first 1] [--tracker mpcc]

``sim://?seed=N``: no calibration, no model, motion capture whose marker sits anywhere. The car
rolls 2 m straight on, so that the room finds its marker, and drives a lap at up to 2 m/s; a disc of
0.15 m at 0.15 m beside the middle moves on at 0.5 m/s, 4 m ahead. Distances are of the true body
and the true rear axle. Some 8 s of CPU a car.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass, field
from math import cos, inf, sin

import numpy as np

from dart_hal.car import Car
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.mpc.obstacles import Obstacle, clearance
from dart_hal.control.plant import plant_of
from dart_hal.control.tracks import track_named
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import UPSTREAM_2024
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import world_of

TRACK = track_named("racetrack_vicon_2")
ROLL, WALK = 2.0, 0.7
"""m at m/s."""
AHEAD, BESIDE, RADIUS, PACE = 4.0, 0.15, 0.15, 0.5
"""m, m, m, m/s of the obstacle."""
AXLE = UPSTREAM_2024.body.l_r
"""m that the middle of the body is before the rear axle."""
LANE, LOST = 0.3, 1.0
"""m to either side; m beside the path at which a drive ends."""


@dataclass
class Passing:
    """Rows (t, way [m], true offset [m], true speed [m/s], offset and gains that are learnt); air:
    least between the true body and the disc [m]."""

    rows: list[tuple[float, ...]] = field(default_factory=list)
    clearance: float = inf
    why: str = ""

    @property
    def most(self) -> float:
        """Largest true offset [m]."""
        return float(np.abs(np.array(self.rows)[:, 2]).max())


def drive(seed: int, speed: float = 2.0, tracker: str = "ca-mpcc") -> Passing:
    """One lap."""
    found, room = Passing(), hidden_mocap(seed)
    c, s = cos(room.yaw), sin(room.yaw)
    backend = open_backend(f"sim://?seed={seed}&nano=mock&mocap=1")
    with tempfile.TemporaryDirectory() as empty, Car.over(backend, cars=empty) as car:
        world, rolled = world_of(backend), False
        follower = Follower(TRACK, plant_of(car.files), speed, tracker,
                            Rules(1.0, duration=60.0, lane=LOST, here=True))
        car.arm()
        for state in car.states(duration=90.0):
            rolled = rolled or state.pose.x > ROLL
            if not rolled:
                car.drive_speed(steering=0.0, speed=WALK)
                continue
            motion = state.estimate.predict(car.now)
            steering, wanted = follower.answer(motion)
            if follower.phase is Phase.ENDED:
                break
            car.drive_speed(steering=steering, speed=wanted)
            path, layers, true = follower.path, follower.tracker, world.truth()
            if follower.phase is Phase.WAITING:
                continue
            if not layers.mpcc.obstacles:
                layers.mpcc.obstacles = (
                    Obstacle(layers.s + AHEAD, BESIDE, RADIUS, PACE, motion.t),)
            x, y = room.x + c * true.x - s * true.y, room.y + s * true.x + c * true.y
            yaw, at = room.yaw + true.yaw, path.closest(x, y, layers.s)
            middle = x + AXLE * cos(yaw), y + AXLE * sin(yaw)
            found.clearance = min(
                found.clearance, clearance(*middle, yaw, layers.mpcc.obstacles[0], path, motion.t)
            )
            found.rows.append((motion.t, at - follower.begun_at, path.offset(x, y, at), true.v_x,
                               *layers._disturbance.value))
        found.why = follower.why
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--tracker", default="ca-mpcc")
    given = parser.parse_args()
    all_ = []
    for seed in range(given.first, given.first + given.seeds):
        found = drive(seed, given.speed, given.tracker)
        rows = np.array(found.rows)
        all_.append((found.clearance, found.most))
        print(f"car {seed}: clearance {100 * found.clearance:5.1f} cm, {found.most:.2f} m off, "
              f"{rows[-1, 1] / (rows[-1, 0] - rows[0, 0]):.2f} m/s; learnt at most "
              + " ".join(f"{v:+.2f}" for v in rows[np.abs(rows[:, 4:]).argmax(axis=0),
                                                   np.arange(4, 7)])
              + f"; {found.why}", flush=True)
    least, most = np.array(all_).T
    print(f"{np.sum((least >= 0.05) & (most <= LANE))} of {len(least)} pass with 5 cm or more and "
          f"keep the lane; {np.sum(least >= 0.05)} pass, {np.sum(most > LANE)} leave the lane; "
          f"least air {100 * least.min():.1f} cm, most off {most.max():.2f} m")


if __name__ == "__main__":
    main()
