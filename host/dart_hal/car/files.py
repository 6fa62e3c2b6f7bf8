"""The files of the car behind an open backend."""

from __future__ import annotations

import os
from pathlib import Path

from dart_hal.core.config import CarFiles, load_car, named_folders, parse_car
from dart_hal.core.config.folders import Folders, parse_run_car
from dart_hal.core.errors import ConfigError
from dart_hal.devices.links.base import Backend

DEFAULT_CAR = "dart-01"
REPLAY_SCHEME = "replay"


def load_files(backend: Backend, car: str | None, cars: str | Path | None) -> CarFiles:
    """Load the files of the car; a notice reports what is not used of them.

    A simulated car brings its car.toml, a recorded run all of its files. For any other car,
    ``car`` names them (None: $DART_HAL_CAR, then dart-01) in the folder ``cars``. Raises as
    ``config.load_car``.
    """
    folders = [cars] if cars else None
    named = car or os.environ.get("DART_HAL_CAR") or DEFAULT_CAR
    # A real car, or a run without files: the files of the folder.
    if backend.car_toml is None:
        loaded = load_car(backend.car or named, folders)
        if backend.url.scheme == REPLAY_SCHEME:
            backend.notices += (f"{backend.url.target} holds no files of its car; those of "
                                f"{loaded.config.name} ({loaded.origin}) are used: steering and "
                                "throttle are wrong if it is another car (--car NAME)",)
        return loaded
    url = backend.url.text
    files = (parse_car(backend.car_toml, url, folders) if backend.simulated
             else _load_run_files(backend, backend.car_toml, folders))
    if backend.simulated and has_measurements(files) and not named_folders(folders):
        backend.notices += (f"what was measured on {files.config.name} is used, from "
                            f"{files.folder}; --cars names another folder",)
    if named not in (DEFAULT_CAR, files.config.name):
        backend.notices += (f"{url} is the car {files.config.name}; the files of {named} are not "
                            "used",)
    return files


def has_measurements(files: CarFiles) -> bool:
    """Return whether the car has a calibration or a model of its own."""
    return files.calibration is not None or files.model is not None


def _load_run_files(backend: Backend, car_toml: str, folders: Folders | None) -> CarFiles:
    """Load the files of a run; a notice reports what this version cannot read."""
    url = backend.url.text
    measured = dict(backend.measured)
    for name, text in backend.measured.items():
        try:
            parse_run_car(car_toml, url, {name: text})
        except ConfigError as error:
            del measured[name]
            backend.notices += (f"{name} in {url} is not used: {error.what}",)
    files = parse_run_car(car_toml, url, measured, folders)
    if folders and files.folder.is_dir():
        backend.measured = {}  # those of the folder count, and are what a recording keeps
    return files
