"""Hours of one drive along a path: does memory grow, does the car drift from the path?

    python -m studies.control.long_drive                  8 hours, some two hours of CPU
    python -m studies.control.long_drive --hours 0.2      a try

One hidden car (MockNano, motion capture, virtual time) drives laps of ``racetrack_vicon_2``. A line
is printed after each fortieth of the drive. At the end: growth of the resident memory after the
first tenth, and the true lateral error of the rear axle in the last eighth over that in the first.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, inf, sin, sqrt
from pathlib import Path
from unittest.mock import patch

import dart_lab.sim.world
from dart_hal.car import Car
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.plant import plant_of
from dart_hal.control.tracks import track_named
from dart_hal.core.types import State
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import world_of
from studies.control.follow_figures import write_files

TRACK = "racetrack_vicon_2"
SETTLING_S = 10.0
"""s from the first motion on that count in no figure."""
CHECKED_STATES = 10
"""The true error is computed in every tenth State: each 0.1 s."""
PARTS = 40
"""Parts of a drive with a figure each: eighths and tenths are whole numbers of them."""
KEPT_RECORDS = 4000
"""Records of its truth and of its bus that the simulator keeps: its usual million and 50,000 would
look like growth."""


@dataclass(frozen=True)
class Part:
    """One of ``PARTS`` parts of a drive: time at its end [s], root mean square and largest true
    lateral error [m], resident memory [bytes]."""

    t: float
    rms: float
    largest: float
    resident: int


def read_resident() -> int:
    """Return the resident memory of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def drive(seconds: float, seed: int, speed: float, tracker: str = "lqr",
          on_state: Callable[[State], None] = lambda state: None) -> Iterator[Part]:
    """Drive for a time and yield its parts.

    Raises RuntimeError if the drive ends before its time.
    """
    with (patch.object(dart_lab.sim.world, "_MAX_RECORDS", KEPT_RECORDS),
          tempfile.TemporaryDirectory() as folder):
        url = f"sim://?seed={seed}&nano=mock&mocap=1"
        write_files(url, seed, Path(folder))
        backend = open_backend(url)
        world = world_of(backend)
        world.bus.log = deque(maxlen=KEPT_RECORDS)
        room = hidden_mocap(seed)
        c, s = cos(room.yaw), sin(room.yaw)
        with Car.over(backend, cars=folder) as car:
            follower = Follower(track_named(TRACK), plant_of(car.files), speed, tracker,
                                Rules(laps=inf, here=True))
            along = begun = end = 0.0
            errors: list[float] = []
            for i, state in enumerate(car.states()):
                steering, target = follower.answer(state.estimate.predict(car.now))
                if follower.phase in (Phase.STOPPING, Phase.ENDED):
                    raise RuntimeError(f"after {state.t:.0f} s: {follower.why}")
                if follower.phase is Phase.WAITING:
                    continue
                if not begun:
                    car.arm()
                    begun = state.t + SETTLING_S
                    along, end = follower.begun_at, begun + seconds / PARTS
                car.drive_speed(steering=steering, speed=target)
                on_state(state)
                if i % CHECKED_STATES:
                    continue
                # The true rear axle in the frame of the poses.
                true = world.truth()
                x = room.x + c * true.x - s * true.y
                y = room.y + s * true.x + c * true.y
                path = follower.path
                along = path.closest(x, y, along)
                if state.t < begun:
                    continue
                errors.append(path.offset(x, y, along))
                if state.t >= end:
                    square = sum(e * e for e in errors) / len(errors)
                    yield Part(state.t, sqrt(square), max(map(abs, errors)), read_resident())
                    errors.clear()
                    end += seconds / PARTS
                    if end > begun + seconds + 0.5 * seconds / PARTS:
                        return


def compare_eighths(parts: list[Part]) -> float:
    """Return the rms error of the last eighth of a drive over that of the first."""
    eighth = PARTS // 8
    first, last = (sqrt(sum(part.rms**2 for part in some) / eighth)
                   for some in (parts[:eighth], parts[-eighth:]))
    return last / first


def measure_growth(parts: list[Part]) -> int:
    """Return the largest memory after the first tenth of a drive minus that at its end [bytes]."""
    tenth = PARTS // 10
    return max(part.resident for part in parts[tenth:]) - parts[tenth - 1].resident


def main() -> None:
    """Drive, and print the figures."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--hours", type=float, default=8.0)
    p.add_argument("--seed", type=int, default=21)
    p.add_argument("--speed", type=float, default=1.0, help="m/s")
    p.add_argument("--tracker", default="lqr")
    o = p.parse_args()
    parts: list[Part] = []
    for part in drive(3600.0 * o.hours, o.seed, o.speed, o.tracker):
        parts.append(part)
        print(f"{part.t / 3600.0:5.2f} h: error {100.0 * part.rms:.2f} cm rms, "
              f"{100.0 * part.largest:.2f} cm at most, {part.resident / 1e6:.1f} MB", flush=True)
    print(f"memory: {measure_growth(parts) / 1e6:+.2f} MB after the first tenth; "
          f"error of the last eighth over the first: {compare_eighths(parts):.3f}")


if __name__ == "__main__":
    main()
