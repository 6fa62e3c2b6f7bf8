"""How much faster than life the emulated car drives, and where the time goes."""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bare_nano import BOOTED, BareNano
from figures import Figure, best_cpu
from mcap.writer import Writer

from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.core.ports import Chunk, Link
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

URL = "sim://?seed=7&nano=avr"
MOCK = "sim://?seed=7&nano=mock"
SPEED, STEERING = 1.5, 0.2
SLICES = (1e-4, 1e-3, 1e-2)
"""s of virtual time that a reader waits at once."""


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; ``scale`` shortens the stretches of virtual time."""
    seconds, rounds = 20.0 * scale, 3
    loop = times_real_time(URL, seconds, rounds)
    recorded = times_real_time(URL, seconds, rounds, record=True)
    bare = bare_times_real_time(seconds, rounds)
    mock = times_real_time(MOCK, seconds, rounds)
    names = "firmware, physics and HAL"
    rows = [
        Figure(f"times real time: {names}", loop, "x", low=8, note="drive_speed at 1.5 m/s"),
        Figure("times real time: the same, recorded", recorded, "x", low=8,
               note=f"MCAP of everything, {loop / recorded:.2f} x the time"),
        Figure("times real time: firmware alone", bare, "x", note=f"{bare / loop:.1f} x the loop"),
        Figure("times real time: mock, physics and HAL", mock, "x",
               note=f"{mock / loop:.1f} x the loop")]
    return [*rows, flushes(10.0 * scale), reading(20.0 * scale), slices(10.0 * scale),
            *split(seconds)]


def flushes(seconds: float) -> Figure:
    """What it costs that a killed recording misses 50 ms at most: chunk, checksum, system call."""
    spent: list[float] = []
    plain = Writer.flush

    def timed(writer: Writer) -> None:
        begin = time.process_time()
        plain(writer)
        spent.append(time.process_time() - begin)

    with tempfile.TemporaryDirectory() as folder, \
            Car.open(MOCK, record=Path(folder) / "run.mcap") as car, \
            patch.object(Writer, "flush", timed):
        spent.clear()
        drive(car, seconds)
        share = sum(spent) / seconds
        return Figure("flushes of a recording, CPU", 1e3 * share, "ms/s",
                      note=f"{len(spent) / seconds:.0f} a second: a kill costs 50 ms of the run")


def reading(seconds: float) -> Figure:
    """How fast a run of this library is read by ``data check``, ``identify`` and ``diagnose``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with Car.open(MOCK, record=path) as car:
            car.arm()
            drive(car, seconds)
        t = read_run(path).messages.t
        return Figure("a recorded run read, times real time",
                      float(t[-1] - t[0]) / best_cpu(lambda: read_run(path), 3), "x",
                      note="file, decoder, estimators and checks")


def drive(car: Car, seconds: float) -> None:
    """The closed loop that is measured."""
    for _ in car.states(duration=seconds):
        car.drive_speed(steering=STEERING, speed=SPEED)


def times_real_time(url: str, seconds: float, rounds: int, record: bool = False) -> float:
    """Virtual seconds per CPU second of a driving, armed car."""
    with tempfile.TemporaryDirectory() as folder, \
            Car.open(url, record=Path(folder) / "run.mcap" if record else None) as car:
        car.arm()
        return seconds / best_cpu(lambda: drive(car, seconds), rounds)


def bare_times_real_time(seconds: float, rounds: int) -> float:
    """The same of the firmware with a turning wheel, in ticks of 1 ms."""
    with BareNano() as bare:
        bare.run(BOOTED)
        bare.roll(SPEED)
        return seconds / best_cpu(lambda: bare.run(seconds, 1e-3), rounds)


# -- repeatable -----------------------------------------------------------------


class SlicedLink:
    """A link whose reader never waits longer than ``length`` s at once."""

    def __init__(self, link: Link, length: float) -> None:
        self._link, self._length = link, length

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def read(self, timeout: float) -> Chunk | None:
        return self._link.read(min(timeout, self._length))


def rx_hash(length: float, seconds: float, url: str = URL) -> str:
    """sha256 of what the Nano sent in a closed loop with that read slice."""
    backend = open_backend(url)
    backend.link = SlicedLink(backend.link, length)  # type: ignore[assignment]
    digest = hashlib.sha256()

    def listen(direction: str, data: bytes, t: float) -> bytes:
        if direction == "rx":
            digest.update(data)
        return data

    with Car.over(backend) as car:
        car.on_bytes(listen)
        car.arm()
        drive(car, seconds)
        return digest.hexdigest()


def slices(seconds: float) -> Figure:
    """How many different streams come out of the same drive."""
    hashes = {rx_hash(length, seconds) for length in SLICES}
    return Figure("different byte streams by read slice", len(hashes), "", 1, 1,
                  f"0.1, 1, 10 ms; sha256 {min(hashes)[:12]}")


# -- where the time goes ----------------------------------------------------------


class Stopwatch:
    """CPU time of wrapped methods, each without that of those inside it."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._inner = [0.0]

    def wrap(self, owner: Any, method: str, name: str) -> None:
        """Count what ``owner.method`` takes under ``name``."""
        setattr(owner, method, self.timed(getattr(owner, method), name))

    def timed(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        clock, inner, spent = time.process_time, self._inner, self.spent

        def call(*args: Any, **options: Any) -> Any:
            start = clock()
            inner.append(0.0)
            try:
                return function(*args, **options)
            finally:
                took = clock() - start
                spent[name] = spent.get(name, 0.0) + took - inner.pop()
                inner[-1] += took
        return call


def split(seconds: float) -> list[Figure]:
    """ms of CPU time per second of driving, by part; the stopwatch itself is in it."""
    watch = Stopwatch()
    backend = open_backend(URL)
    world = world_of(backend)
    with tempfile.TemporaryDirectory() as folder, \
            Car.over(backend, record=Path(folder) / "run.mcap") as car:
        engine = car._engine
        car.arm()
        watch.wrap(world.nano, "run", "firmware in simavr")
        watch.wrap(world, "_step_physics", "physics tick")
        watch.wrap(engine.receiver, "feed", "decoder and estimators")
        watch.wrap(engine.driver, "frame", "pulses, ServoKit, bus")
        watch.wrap(engine.driver.actuator, "command", "command chain")
        watch.wrap(engine.transmitter, "send", "frames down")
        for method in ("rx", "tx", "applied", "command"):
            watch.wrap(car._recorder._writer, method, "recording")
        engine.listeners[:] = [watch.timed(f, "recording") for f in engine.listeners]
        watch.timed(drive, "loop, link, supervisor")(car, seconds)
    total = sum(watch.spent.values())
    return [Figure(f"of it: {name}", 1e3 * spent / seconds, "ms per s",
                   note=f"{spent / total:.0%}")
            for name, spent in sorted(watch.spent.items(), key=lambda item: -item[1])]
