"""Several cars in lockstep: one State of each per tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from math import inf
from pathlib import Path
from types import TracebackType
from typing import TypeVar
from urllib.parse import quote

from dart_hal.car.car import Car
from dart_hal.car.member import Member, join
from dart_hal.car.misuse import check_record
from dart_hal.car.recorder import Record, keep_old
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import PoseSource
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import Contact, State
from dart_hal.devices.poses import open_fleet_poses
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.peers import OtherPose
from dart_hal.recording.run_file import RunFile

T = TypeVar("T")


class Fleet:
    """Cars that are driven together; a context manager. ``cars`` in the order of the URLs.

    ``names``: of each, no two alike; ``members``: each in the room that ``open`` was given.
    """

    def __init__(self, cars: Sequence[Car]) -> None:
        self.cars = tuple(cars)
        self.names = _names(self.cars)
        self.members: tuple[Member, ...] = ()

    @classmethod
    def open(cls, urls: Sequence[str], *, car: Sequence[str | None] | None = None,
             cars: str | Path | None = None,
             record: str | Path | Sequence[str | Path | None] | None = None,
             poses: str | Sequence[str | PoseSource | None] | None = None,
             room: str | None = None, room_key: RoomKey | str | Path | None = None,
             raise_on_trip: bool = True) -> Fleet:
        """Open every URL, or none: what was opened is closed if one fails.

        ``car``, ``record``, ``poses``: one entry for each URL, as ``Car.open``
        takes it. Of UDP poses several may name one port, each with its body.
        ``record`` as one file: of all cars on one time base, the channels of each
        with its name; read it as FILE?car=NAME. ``poses`` as one text: "{car}" in it
        is the car's name in ``car``. ``room``: URL of a room of cars (``dart_hal.fleet``)
        that all of them enter; ``room_key`` as ``join`` takes it.
        Raises UsageError where their number is another, and where two real cars
        would drive with the files of one; and what ``Car.open`` raises.
        """
        names = _each("car", car, urls)
        seen = _each("poses", _spelled(poses, names), urls)
        with ExitStack() as stack:
            files = _records(record, urls, stack)
            sources = _sources(seen, stack)
            opened = [stack.enter_context(Car.open(url, car=name, cars=cars, record=run,
                                                   poses=source,
                                                   raise_on_trip=raise_on_trip))
                      for url, name, run, source in zip(urls, names, files, sources, strict=True)]
            _distinct(opened)
            fleet = cls(opened)
            if room is not None:
                fleet.members = tuple(stack.enter_context(join(one, room, name=name,
                                                                room_key=room_key))
                                      for one, name in zip(opened, fleet.names, strict=True))
            stack.pop_all()
        return fleet

    def arm(self, *, waive: Sequence[str] = ()) -> None:
        """Arm all at once; if one refuses, all are stopped. Raises NotArmed."""
        try:
            waiting = [car.arming(waive=waive) for car in self.cars]
            while waiting:
                waiting = [steps for steps in waiting if next(steps, None) is not None]
        except BaseException:
            self.stop()
            raise

    def states(self, *, duration: float = inf, timeout: float = 0.5) -> Iterator[tuple[State, ...]]:
        """One State per car at each tick of the first car; ends with the first car that ends.

        The Nanos' clocks differ by up to half a percent: the States of a tick
        are within half a frame of each other, counted from the first tick. A
        car that is ahead shows its State again, one that is behind skips one.
        Emulated cars in virtual time are brought to the same time first.
        """
        streams = [car.states(duration=inf, timeout=timeout) for car in self.cars]
        try:
            now = [next(stream) for stream in streams]
            worlds = [n for n, car in enumerate(self.cars) if car.waits and car.drives]
            latest = max((self.cars[n].now for n in worlds), default=0.0)
            for n in worlds:
                while self.cars[n].now < latest - SAMPLE / 2:
                    now[n] = next(streams[n])
            start = [state.t for state in now]
            while now:
                yield tuple(now)
                passed = now[0].t - start[0]
                if passed >= duration - 1.5 * SAMPLE:
                    return
                now[0] = next(streams[0])
                tick = now[0].t - start[0] - SAMPLE / 2
                for n in range(1, len(now)):
                    while now[n].t - start[n] < tick:
                        now[n] = next(streams[n])
        except StopIteration:
            return

    def other_poses(self, name: str) -> dict[str, OtherPose]:
        """What the car of this name knows of all others in the room. Raises UsageError."""
        if name not in self.names or not self.members:
            raise UsageError(f"no car {name} in a room", found=name,
                             expected=", ".join(self.names) if self.members else
                             'Fleet.open(urls, room="local://")')
        return self.members[self.names.index(name)].other_poses()

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Of emulated cars in one world (``sim://?world=NAME``): who touched whom, in order."""
        every = dict.fromkeys(c for car in self.cars for c in car.contacts)
        return tuple(sorted(every, key=lambda c: c.t))

    def stop(self, why: str = "") -> None:
        """Stop every car, also when one of them raises, and all others in the room."""
        with ExitStack() as stack:
            if self.members:
                stack.callback(self.members[0].stop_all, why)
            for car in self.cars:
                stack.callback(car.stop)

    def close(self) -> None:
        """Close every car, also when one of them raises."""
        with ExitStack() as stack:
            for member in self.members:
                stack.callback(member.close)
            for car in self.cars:
                stack.callback(car.close)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


def _each(name: str, given: Sequence[T] | None, urls: Sequence[str]) -> Sequence[T | None]:
    """One entry for each URL. Raises UsageError."""
    if given is None:
        return [None] * len(urls)
    if isinstance(given, str) or len(given) != len(urls):
        raise UsageError(f"{name}= of a fleet has one entry for each URL", found=repr(given),
                         expected=f"{len(urls)} entries")
    return list(given)


def _records(record: str | Path | Sequence[str | Path | None] | None, urls: Sequence[str],
             stack: ExitStack) -> Sequence[Record | None]:
    """A file for each car, or one for all, which closes if opening fails. Raises UsageError."""
    if not isinstance(record, (str, Path)):
        return _each("record", record, urls)
    check_record(record)
    keep_old(record)
    Path(record).parent.mkdir(parents=True, exist_ok=True)
    shared = RunFile(record)
    stack.callback(shared.close)
    return [shared] * len(urls)


def _spelled(poses: str | Sequence[str | PoseSource | None] | None, names: Sequence[str | None]
             ) -> Sequence[str | PoseSource | None] | None:
    """One stream for all, with each car's name where "{car}" stands. Raises UsageError."""
    if not isinstance(poses, str):
        return poses
    if "{car}" not in poses or None in names:
        raise UsageError("one stream of poses needs a body for each car", found=poses,
                         expected='poses="udp://:5005?body={car}" and car=["dart-01", ...]')
    return [poses.replace("{car}", quote(str(name))) for name in names]


def _sources(given: Sequence[str | PoseSource | None], stack: ExitStack
             ) -> list[str | PoseSource | None]:
    """Open what is a URL of many; closed with the stack, as are the cars'. A car's own lidar is
    its car's to open. Raises as ``open_poses``."""
    shared = [isinstance(one, str) and not one.startswith("lidar:") for one in given]
    opened = iter(open_fleet_poses([str(one) for one, of_many in zip(given, shared, strict=True)
                                    if of_many]))
    sources: list[str | PoseSource | None] = [next(opened) if of_many else one
                                              for one, of_many in zip(given, shared, strict=True)]
    for source in sources:
        if source is not None and not isinstance(source, str):
            stack.callback(source.close)
    return sources


def _names(cars: Sequence[Car]) -> tuple[str, ...]:
    """Names of the cars' files; of several with one name the second is NAME-2, and so on."""
    given: list[str] = []
    for car in cars:
        name, number = car.files.config.name, 1
        while (unique := name if number == 1 else f"{name}-{number}") in given:
            number += 1
        given.append(unique)
    return tuple(given)


def _distinct(cars: Sequence[Car]) -> None:
    """Raise UsageError where two real cars have one car's calibration."""
    names = [car.files.config.name for car in cars if not car.simulated]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"two cars of the fleet have the files of {', '.join(twice)}",
                         found=", ".join(car.url for car in cars),
                         expected="the files of each car, measured on it",
                         remedy='Fleet.open(urls, car=["dart-01", "dart-02"])')
