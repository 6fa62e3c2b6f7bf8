"""Open a car for a verb, with notices, progress and real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dart_hal.car import Car
from dart_hal.car.car import open_url
from dart_hal.car.viewers import open_viewer
from dart_hal.cli.common.output import CTRL_C_STATUS, progress_bar, show_notices
from dart_hal.cli.common.simulated_room import load_simulator
from dart_hal.control.ending import Ending
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.types import State
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.field import Map, map_of_grid
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.estimation.localisation.source import open_source

INTERRUPTED = "stopped by Ctrl-C"


@contextmanager
def open_car(url: str | None, car_name: str, cars: Path | None,
             record: Path | None = None, poses: str | None = None, lidar: str | None = None,
             camera: str | None = None, guard_distance: float | None = None) -> Iterator[Car]:
    """Open a car and show its notices; close it at neutral afterwards.

    poses "lidar" or "lidar?start=X,Y,YAW": locate a simulated car by its lidar, in the map of its
    room. guard_distance [m]: as in ``Car.open``.
    """
    with (_open_located_by_lidar(url, car_name, cars, record, poses, lidar, camera,
                                 guard_distance)
          if poses is not None and poses.partition("?")[0] == "lidar" else
          Car.open(url, car=car_name, cars=cars, record=record, poses=poses, lidar=lidar,
                   camera=camera, guard_distance=guard_distance)) as car:
        show_notices(car.notices)
        yield car
        show_sensor_errors(car)


@contextmanager
def end_on_interrupt(car: Car, drive: Ending) -> Iterator[None]:
    """Stop the car at Ctrl-C and end the drive, so that its figures are reported."""
    try:
        yield
    except KeyboardInterrupt:
        car.stop()
        drive.stop(INTERRUPTED, good=False)


def exit_status(drive: Ending) -> int:
    """Return the exit status of the verb that drove, as ``main`` lists them."""
    return 0 if drive.good else CTRL_C_STATUS if drive.why == INTERRUPTED else 1


@contextmanager
def serve_foxglove(car: Car, enabled: bool, port: int) -> Iterator[None]:
    """Serve the car to Foxglove while a verb drives it, if ``enabled``."""
    if not enabled:
        yield
        return
    with open_viewer("foxglove", car, port=port) as server:
        show_notices((f"Foxglove: open ws://localhost:{server.port}; "
                      f"layout to import: {server.layout}",))
        yield


def check_drives_by_lidar(car: Car, room: str) -> None:
    """Raise UsageError for a car without actuators or lidar; room: of the suggested URL."""
    if not car.drives:
        raise UsageError(f"{car.url} has no actuators", expected="a car with its I2C bus",
                         remedy=f"sim://?lidar=1&map={room}, or serial:///dev/ttyUSB0?i2c=1")
    if not car.has_lidar:
        raise UsageError(f"{car.url} has no lidar", expected=f"a lidar that measures the {room}",
                         remedy=f"sim://?lidar=1&map={room}, or --lidar serial:///dev/dart-lidar")


def show_sensor_errors(car: Car) -> None:
    """Show why the lidar sent no scans, or the camera no images."""
    errors = (car.lidar.trouble if car.has_lidar else None,
              car.camera.trouble if car.has_camera else None)
    show_notices(tuple(str(error) for error in errors if error is not None))


def _open_located_by_lidar(url: str | None, car_name: str, cars: Path | None, record: Path | None,
                           poses: str, lidar: str | None, camera: str | None,
                           guard_distance: float | None) -> Car:
    # The simulated room is needed before the car: the source of poses is in its map.
    backend = open_url(url)
    try:
        source = open_source(poses, load_map(backend))
    except DartHalError:
        backend.close()
        raise
    return Car.over(backend, car=car_name, cars=cars, record=record, poses=source, lidar=lidar,
                    camera=camera, guard_distance=guard_distance)


def load_map(backend: Backend, chart: Path | None = None) -> Map:
    """Load a map from a file, or that of the room of a simulated car.

    Raises UsageError for a real car without a file, and closes the backend on an error.
    """
    try:
        if chart is not None:
            return map_of_grid(read_grid(chart))
        if backend.url.scheme != "sim":
            raise UsageError(f"{backend.url.text}: a real car needs a map", found="no --map",
                             expected="--map FILE.yaml")
        return load_simulator(backend.url.scheme).map_of_room(backend)
    except DartHalError:
        backend.close()
        raise


def with_progress(states: Iterator[State], duration: float, title: str) -> Iterator[State]:
    """Yield states of a drive of ``duration`` [s] and show a progress bar on standard error."""
    with progress_bar() as bar:
        task = bar.add_task(title, total=duration)
        start: float | None = None
        for n, state in enumerate(states):
            start = state.t if start is None else start
            # Five updates of the bar per second are enough at 100 States per second.
            if n % 20 == 0:
                bar.update(task, completed=state.t - start)
            yield state


def real_time_url(url: str | None) -> str:
    """Return the URL; of a simulated car with ``pace=1``, so that it runs in real time."""
    text = url or "sim://"
    parsed = Url.parse(text)
    if parsed.scheme != "sim" or "pace" in parsed.options:
        return text
    return text + ("&" if "?" in text else "?") + "pace=1"


def limit_to_real_time(states: Iterator[State]) -> Iterator[State]:
    """Yield states no faster than their time stamps, so that a person can drive a simulation."""
    # Wall clock and car time of the first state.
    start: tuple[float, float] | None = None
    for state in states:
        if start is None:
            start = (time.monotonic(), state.t)
        lead = (state.t - start[1]) - (time.monotonic() - start[0])
        if lead > 0.0:
            time.sleep(lead)
        yield state
