"""Several cars: how soon a stop reaches the last ESC, and what a fleet costs.

    python benchmarks/bench_fleet.py            everything
    python benchmarks/bench_fleet.py stop       s from the call to the last driving pulse, 24 seeds
    python benchmarks/bench_fleet.py cost       CPU of 20 cars, 5 of them with lidar, matcher, run
    python benchmarks/bench_fleet.py real       the same cars in real time: do they keep up?
    python benchmarks/bench_fleet.py tick       us of one car per ms of its world, and where
"""

from __future__ import annotations

import cProfile
import multiprocessing
import pstats
import resource
import sys
import tempfile
import time
from contextlib import suppress

from dart_hal.car import Car, Fleet, join
from dart_hal.core.errors import NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.source import LidarPoses
from dart_lab.sim.truth import room_of_car, world_of

CARS, SEEING, PROCESSES = 20, 5, 2
SECONDS = 10.0
SEEDS = 24


def stop_once(room: str, number: int) -> float:
    """s from the first car's call to the end of the other's last driving pulse; 0: none ended."""
    pulses: list[tuple[float, float]] = []
    backends = [open_backend(f"sim://?nano=mock&seed={seed}")
                for seed in (2 * number + 1, 2 * number + 2)]
    world = world_of(backends[1])
    world.watchers.append(lambda channel, pulse: pulses.append(pulse) if channel == 1 else None)
    with Fleet([Car.over(backend, raise_on_trip=False) for backend in backends]) as fleet:
        fleet.members = tuple(join(car, room, name=name)
                              for car, name in zip(fleet.cars, fleet.names, strict=True))
        fleet.arm()
        for _ in fleet.states(duration=0.5 + 0.01 * (number % 7)):
            for car in fleet.cars:
                car.drive(throttle=0.25)
        called = world.t
        fleet.members[0].stop_all()
        for _ in fleet.states(duration=1.0):
            fleet.cars[1].drive(throttle=0.25)
    return max(0.0, *(fall - called for rise, fall in pulses if abs(fall - rise - 1.5e-3) > 1e-5))


def stop() -> None:
    for loss in (0.0, 0.5):
        found = sorted(1e3 * stop_once(f"local://bench?loss={loss}&seed={seed}", seed)
                       for seed in range(SEEDS))
        print(f"stop at a loss of {loss:.0%}: {found[0]:.0f} to {found[-1]:.0f} ms, "
              f"median {found[len(found) // 2]:.0f}, {len(found)} seeds")


def share(first: int, cars: int, seeing: int, folder: str, pace: str = ""
          ) -> tuple[float, float, float, int]:
    """(wall, CPU, least time of a car) s, cars still armed, of a process that drives its share
    of the fleet for ``SECONDS``."""
    where = "&lidar=1&map=corridor"
    urls = [f"sim://?nano=mock&seed={first + n}{pace}" + (where if n < seeing else "")
            for n in range(cars)]
    poses = [_localiser(url.replace(pace, "")) if n < seeing else None
             for n, url in enumerate(urls)]
    record = [f"{folder}/{first + n}.mcap" if n < seeing else None for n in range(cars)]
    room = "udp://239.255.42.98:7448?via=127.0.0.1"
    with Fleet.open(urls, record=record, poses=poses, room=room, raise_on_trip=False) as fleet:
        with suppress(NotArmed):  # in real time, of cars that do not keep up: none is armed
            fleet.arm()
        wall, cpu = time.perf_counter(), time.process_time()
        begin = [car.now for car in fleet.cars]
        for _ in fleet.states(duration=SECONDS):
            for car in fleet.cars:
                car.drive(throttle=0.22, steering=0.3)
        return (time.perf_counter() - wall, time.process_time() - cpu,
                min(car.now - t for car, t in zip(fleet.cars, begin, strict=True)),
                sum(car.mode == "ARMED" for car in fleet.cars))


def _localiser(url: str) -> LidarPoses:
    """Of a car that knows the map of its room and where it begins."""
    backend = open_backend(url)
    room = room_of_car(backend)
    backend.close()
    return LidarPoses(map_of_lines(room.lines), room.start)


def fleets(pace: str) -> None:
    """Both processes at once."""
    with tempfile.TemporaryDirectory() as folder, \
            multiprocessing.get_context("spawn").Pool(PROCESSES) as pool:
        each = CARS // PROCESSES
        seeing = [SEEING // PROCESSES + (n < SEEING % PROCESSES) for n in range(PROCESSES)]
        done = pool.starmap(share, [(1 + each * n, each, seeing[n], folder, pace)
                                    for n in range(PROCESSES)])
    for (wall, cpu, least, armed), n in zip(done, seeing, strict=True):
        print(f"{each} cars, {n} of them with lidar, matcher and recording: {SECONDS:.0f} s in "
              f"{wall:.1f} s by the wall ({wall / SECONDS:.2f} of real time), {cpu:.1f} s of CPU"
              + (f"; the slowest lived {least:.1f} s, {armed} are still armed" if pace else ""))


def cost() -> None:
    fleets("")


def real() -> None:
    fleets("&pace=1")


def tick() -> None:
    for options in ("", "&lidar=1", "&physics=kinematic", "&physics=kinematic&tick=10"):
        with Car.open(f"sim://?nano=mock&seed=1{options}") as car:
            car.arm()
            drive(car, 0.5)
            best = min(drive(car, 2.0) for _ in range(3))
        print(f"{options or 'plain':30} {best / 2.0 * 1e3:6.1f} us per ms of its world")
    with Car.open("sim://?nano=mock&seed=1") as car:
        car.arm()
        profile = cProfile.Profile()
        profile.enable()
        drive(car, 2.0)
        profile.disable()
        pstats.Stats(profile).sort_stats("tottime").print_stats(12)


def drive(car: Car, seconds: float) -> float:
    """CPU s of it."""
    before = resource.getrusage(resource.RUSAGE_SELF)
    for _ in car.states(duration=seconds):
        car.drive(throttle=0.25, steering=0.1)
    after = resource.getrusage(resource.RUSAGE_SELF)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


if __name__ == "__main__":
    for part in sys.argv[1:] or ("stop", "cost", "tick"):
        {"stop": stop, "cost": cost, "real": real, "tick": tick}[part]()
