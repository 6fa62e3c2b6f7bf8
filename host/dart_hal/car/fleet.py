"""``Fleet``: several cars in lockstep, one State of each per tick."""

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
from dart_hal.car.recorder import Record, rename_existing
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.ports import PoseSource
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import Contact, State
from dart_hal.devices.poses import open_fleet_poses
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.peers import OtherPose
from dart_hal.recording.run_file import RunFile

EntryT = TypeVar("EntryT")


class Fleet:
    """Cars that are driven together. Made by ``Fleet.open``; a context manager.

    Attributes:
        cars: the cars, in the order of the URLs.
        names: their names, each unique: a second "dart-01" is "dart-01-2".
        members: the member of each car in the room that ``open`` was given; else empty.

    The examples of the methods use this fleet, which has been opened but not armed::

        from dart_hal import Fleet
        fleet = Fleet.open(["sim://?nano=mock&seed=1", "sim://?nano=mock&seed=2"])
    """

    def __init__(self, cars: Sequence[Car]) -> None:
        self.cars = tuple(cars)
        self.names = _unique_names(self.cars)
        self.members: tuple[Member, ...] = ()

    @classmethod
    def open(cls, urls: Sequence[str], *, car: Sequence[str | None] | None = None,
             cars: str | Path | None = None,
             record: str | Path | Sequence[str | Path | None] | None = None,
             poses: str | Sequence[str | PoseSource | None] | None = None,
             room: str | None = None, room_key: RoomKey | str | Path | None = None,
             raise_on_trip: bool = True) -> Fleet:
        """Open all cars, or none: if one fails, those that are open are closed.

        Args:
            urls: URL of each car.
            car: name of each car's files; None: as ``Car.open``.
            cars: folder with the files of the cars.
            record: one MCAP file for all cars, read as FILE?car=NAME, on one time base; or a file
                (None: no recording) for each car.
            poses: one URL with "{car}" in it, which is replaced by each car's name in ``car``; or a
                source, URL or None for each car. Several UDP sources may share a port, each with a
                body of its own.
            room: URL of a room (``dart_hal.fleet``) that all cars enter.
            room_key: key of the room, as in ``join``.
            raise_on_trip: as in ``Car.open``.

        Returns:
            The open fleet, all cars at neutral and disarmed.

        Raises:
            UsageError: the number of entries differs from the number of URLs, or two real cars
                have the files of one.
            Also what ``Car.open`` raises.

        Example:
            >>> with Fleet.open(["sim://?nano=mock", "sim://?nano=mock&seed=2"]) as example:
            ...     len(example.cars)
            2
        """
        names = _entry_per_url("car", car, urls)
        sources_by_url = _entry_per_url("poses", _expand_poses(poses, names), urls)
        with ExitStack() as stack:
            files = _open_records(record, urls, stack)
            sources = _open_sources(sources_by_url, stack)
            opened = [stack.enter_context(Car.open(url, car=name, cars=cars, record=run,
                                                   poses=source,
                                                   raise_on_trip=raise_on_trip))
                      for url, name, run, source in zip(urls, names, files, sources, strict=True)]
            _check_distinct(opened)
            fleet = cls(opened)
            if room is not None:
                fleet.members = tuple(stack.enter_context(join(one, room, name=name,
                                                                room_key=room_key))
                                      for one, name in zip(opened, fleet.names, strict=True))
            stack.pop_all()
        return fleet

    def arm(self, *, waive: Sequence[str] = ()) -> None:
        """Arm all cars at the same time; if one refuses, all are stopped.

        Args:
            waive: checks to leave out, as in ``Car.arm``.

        Raises:
            NotArmed: with the reasons of the car that refused.

        Example:
            >>> fleet.arm()
            >>> [car.mode for car in fleet.cars]
            ['ARMED', 'ARMED']
        """
        try:
            waiting = [_name_errors(name, car.arming(waive=waive))
                       for name, car in zip(self.names, self.cars, strict=True)]
            while waiting:
                waiting = [steps for steps in waiting if next(steps, None) is not None]
        except BaseException:
            self.stop()
            raise

    def states(self, *, duration: float = inf, timeout: float = 0.5) -> Iterator[tuple[State, ...]]:
        """Yield one State per car at each tick of the first car, at 100 Hz.

        The clocks of the Nanos differ by up to 0.5 %. The States of a tick are within half a
        frame of each other, counted from the first tick: a car that is ahead yields its State
        twice, one that is behind skips one. Emulated cars in virtual time are brought to the same
        time first.

        Args:
            duration: length [s] of the first car's time.
            timeout: longest wait [s] for a frame.

        Returns:
            Iterator of tuples of State, in the order of ``cars``. It ends with the first car that
            ends.

        Raises:
            LinkLost: a car sent no frame for ``timeout``.

        Example:
            >>> for states in fleet.states(duration=0.1):
            ...     pass
            >>> len(states)
            2
        """
        if duration == 0.0:
            return
        streams = [_name_errors(name, car.states(duration=inf, timeout=timeout))
                   for name, car in zip(self.names, self.cars, strict=True)]
        try:
            now = [next(stream) for stream in streams]
            # 1. Bring the emulated cars to the same time.
            worlds = [n for n, car in enumerate(self.cars) if car.waits and car.drives]
            latest = max((self.cars[n].now for n in worlds), default=0.0)
            for n in worlds:
                while self.cars[n].now < latest - SAMPLE / 2:
                    now[n] = next(streams[n])
            # 2. At each tick of the first car, read each other car until it is within half a frame.
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
        """Return the last known pose of each other car in the room, as one car received it.

        Args:
            name: name of the car that received it, one of ``names``.

        Returns:
            Pose and age by name.

        Raises:
            UsageError: the fleet has no such car, or is in no room.

        Example:
            >>> urls = ["sim://?nano=mock", "sim://?nano=mock&seed=2"]
            >>> with Fleet.open(urls, room="local://") as example:
            ...     for states in example.states(duration=0.2):
            ...         pass
            ...     len(example.other_poses(example.names[0]))
            1
        """
        if name not in self.names or not self.members:
            raise UsageError(f"no car {name} in a room", found=name,
                             expected=", ".join(self.names) if self.members else
                             'Fleet.open(urls, room="local://")')
        return self.members[self.names.index(name)].other_poses()

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Return the contacts of emulated cars in one world (``sim://?world=NAME``), in order.

        Example:
            >>> fleet.contacts
            ()
        """
        every = dict.fromkeys(c for car in self.cars for c in car.contacts)
        return tuple(sorted(every, key=lambda c: c.t))

    def stop(self, why: str = "") -> None:
        """Stop all cars, and all other cars in the room, also when one of them raises.

        Args:
            why: reason, for the other cars in the room.

        Example:
            >>> fleet.stop()
            >>> [car.mode for car in fleet.cars]
            ['DISARMED', 'DISARMED']
        """
        with ExitStack() as stack:
            if self.members:
                stack.callback(self.members[0].stop_all, why)
            for car in self.cars:
                stack.callback(car.stop)

    def close(self) -> None:
        """Stop all cars, then close them, also when one of them raises; idempotent.

        Example:
            >>> fleet.close()
            >>> [car.mode for car in fleet.cars]
            ['CLOSED', 'CLOSED']
        """
        with ExitStack() as stack:
            for member in self.members:
                stack.callback(member.close)
            for car in self.cars:
                stack.callback(car.close)
            # Run first: closing takes 0.2 s a car, in which the others would drive on.
            for car in self.cars:
                stack.callback(car.stop)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


def _entry_per_url(name: str, given: Sequence[EntryT] | None, urls: Sequence[str]
                   ) -> Sequence[EntryT | None]:
    """Return one entry for each URL. Raises UsageError."""
    if given is None:
        return [None] * len(urls)
    if isinstance(given, str) or len(given) != len(urls):
        raise UsageError(f"{name}= of a fleet has one entry for each URL", found=repr(given),
                         expected=f"{len(urls)} entries")
    return list(given)


def _open_records(record: str | Path | Sequence[str | Path | None] | None, urls: Sequence[str],
             stack: ExitStack) -> Sequence[Record | None]:
    """Return the recording of each car. A shared file is closed if opening fails.

    Raises UsageError.
    """
    if not isinstance(record, (str, Path)):
        entries = _entry_per_url("record", record, urls)
        names = [str(Path(name).resolve()) for name in entries if isinstance(name, str | Path)]
        if len(set(names)) < len(names):
            raise UsageError("two cars of a fleet have one recording", found=repr(record),
                             expected="another file for each car",
                             remedy="record=\"fleet.mcap\" records all cars in one file")
        return entries
    check_record(record)
    rename_existing(record)
    Path(record).parent.mkdir(parents=True, exist_ok=True)
    shared = RunFile(record)
    stack.callback(shared.close)
    return [shared] * len(urls)


def _expand_poses(poses: str | Sequence[str | PoseSource | None] | None, names: Sequence[str | None]
             ) -> Sequence[str | PoseSource | None] | None:
    """Return the poses of each car: one URL with each car's name in place of "{car}".

    Raises UsageError.
    """
    if not isinstance(poses, str):
        return poses
    if "{car}" not in poses or None in names:
        raise UsageError("one stream of poses needs a body for each car", found=poses,
                         expected='poses="udp://:5005?body={car}" and car=["dart-01", ...]')
    return [poses.replace("{car}", quote(str(name))) for name in names]


def _open_sources(given: Sequence[str | PoseSource | None], stack: ExitStack
             ) -> list[str | PoseSource | None]:
    """Open the sources of poses that several cars may share; they are closed with the stack.

    Poses by the lidar of a car remain a URL: ``Car.open`` opens them. Raises as ``open_poses``.
    """
    shared = [isinstance(one, str) and not one.startswith("lidar:") for one in given]
    opened = iter(open_fleet_poses([str(one) for one, of_many in zip(given, shared, strict=True)
                                    if of_many]))
    sources: list[str | PoseSource | None] = [next(opened) if of_many else one
                                              for one, of_many in zip(given, shared, strict=True)]
    for source in sources:
        if source is not None and not isinstance(source, str):
            stack.callback(source.close)
    return sources


def _name_errors(name: str, states: Iterator[State]) -> Iterator[State]:
    """Yield the States of a car; an error of it has the name of the car."""
    try:
        yield from states
    except DartHalError as error:
        error.what = f"car {name}: {error.what}"
        raise


def _unique_names(cars: Sequence[Car]) -> tuple[str, ...]:
    """Return the names of the cars' files; the second of several with one name is NAME-2."""
    given: list[str] = []
    for car in cars:
        name = car.files.config.name
        number = 1
        while (unique := name if number == 1 else f"{name}-{number}") in given:
            number += 1
        given.append(unique)
    return tuple(given)


def _check_distinct(cars: Sequence[Car]) -> None:
    """Raise UsageError if two real cars have the calibration of one car."""
    names = [car.files.config.name for car in cars if not car.simulated]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"two cars of the fleet have the files of {', '.join(twice)}",
                         found=", ".join(car.url for car in cars),
                         expected="the files of each car, measured on it",
                         remedy='Fleet.open(urls, car=["dart-01", "dart-02"])')
