"""Opening a car for a verb: notices shown, progress drawn, pace kept."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dart_hal.car import Car
from dart_hal.car.car import backend_of
from dart_hal.car.viewers import open_viewer
from dart_hal.cli.common.output import notices, progress_bar
from dart_hal.cli.common.simulated_room import load_simulator
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.types import State
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.field import Map, map_of_grid
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.estimation.localisation.source import open_source


@contextmanager
def opened(url: str | None, car_name: str, cars: Path | None,
           record: Path | None = None, poses: str | None = None, lidar: str | None = None,
           camera: str | None = None) -> Iterator[Car]:
    """An open car whose notices have been shown; closed at neutral afterwards.

    poses "lidar", "lidar?start=X,Y,YAW": of a simulated car, by its lidar in the map of its room.
    """
    with (_by_lidar(url, car_name, cars, record, poses, lidar, camera)
          if poses is not None and poses.partition("?")[0] == "lidar" else
          Car.open(url, car=car_name, cars=cars, record=record, poses=poses, lidar=lidar,
                   camera=camera)) as car:
        notices(car.notices)
        yield car
        say_trouble(car)


@contextmanager
def shown_live(car: Car, wanted: bool, port: int) -> Iterator[None]:
    """The car in Foxglove while a verb drives it, where that is wanted."""
    if not wanted:
        yield
        return
    with open_viewer("foxglove", car, port=port) as server:
        notices((f"Foxglove: open ws://localhost:{server.port}; "
                 f"layout to import: {server.layout}",))
        yield


def check_drives_by_lidar(car: Car, room: str) -> None:
    """Raises UsageError for a car that cannot drive, or sees nothing; room: an example's."""
    if not car.drives:
        raise UsageError(f"{car.url} has nothing to drive", expected="a car with its I2C bus",
                         remedy=f"sim://?lidar=1&map={room}, or serial:///dev/ttyUSB0?i2c=1")
    if not car.has_lidar:
        raise UsageError(f"{car.url} has no lidar", expected=f"one that sees the {room}",
                         remedy=f"sim://?lidar=1&map={room}, or --lidar serial:///dev/dart-lidar")


def say_trouble(car: Car) -> None:
    """Why no scans came of a lidar that was named, or no images of a camera."""
    troubles = (car.lidar.trouble if car.has_lidar else None,
                car.camera.trouble if car.has_camera else None)
    notices(tuple(str(why) for why in troubles if why is not None))


def _by_lidar(url: str | None, car_name: str, cars: Path | None, record: Path | None,
              poses: str, lidar: str | None, camera: str | None) -> Car:
    backend = backend_of(url)
    try:
        source = open_source(poses, map_of(backend))
    except DartHalError:
        backend.close()
        raise
    return Car.over(backend, car=car_name, cars=cars, record=record, poses=source, lidar=lidar,
                    camera=camera)


def map_of(backend: Backend, chart: Path | None = None) -> Map:
    """The map in a file; without one that of a simulated car's room. Raises UsageError, and the
    backend is closed then."""
    try:
        if chart is not None:
            return map_of_grid(read_grid(chart))
        if backend.url.scheme != "sim":
            raise UsageError(f"{backend.url.text}: in which map?", expected="--map FILE.yaml")
        return load_simulator(backend.url.scheme).map_of_room(backend)
    except DartHalError:
        backend.close()
        raise


def with_progress(states: Iterator[State], duration: float, title: str) -> Iterator[State]:
    """States of a stretch of known length, with a bar on standard error."""
    with progress_bar() as bar:
        task = bar.add_task(title, total=duration)
        start: float | None = None
        for n, state in enumerate(states):
            start = state.t if start is None else start
            if n % 20 == 0:
                bar.update(task, completed=state.t - start)
            yield state


def paced(url: str | None) -> str:
    """The URL; a simulated car keeps to the time of who looks at it, as a real one does."""
    text = url or "sim://"
    known = Url.parse(text)
    if known.scheme != "sim" or "pace" in known.options:
        return text
    return text + ("&" if "?" in text else "?") + "pace=1"


def in_real_time(states: Iterator[State]) -> Iterator[State]:
    """States no faster than their own times: for a person at the wheel of a simulation."""
    begin: tuple[float, float] | None = None
    for state in states:
        if begin is None:
            begin = (time.monotonic(), state.t)
        ahead = (state.t - begin[1]) - (time.monotonic() - begin[0])
        if ahead > 0.0:
            time.sleep(ahead)
        yield state
