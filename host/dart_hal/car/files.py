"""Whose files an opened backend drives by."""

from __future__ import annotations

import os
from pathlib import Path

from dart_hal.core.config import CarFiles, load_car, named_folders, parse_car
from dart_hal.core.config.folders import Folders, parse_run_car
from dart_hal.core.errors import ConfigError
from dart_hal.devices.links.base import Backend

DEFAULT_CAR = "dart-01"
REPLAY = "replay"


def files_of(backend: Backend, car: str | None, cars: str | Path | None) -> CarFiles:
    """The files of the car behind ``backend``; what is not used of them becomes a notice.

    A simulated car brings its car.toml, a recorded run all that it was driven by; any other is
    ``car``, None: $DART_HAL_CAR, then dart-01, below ``cars``. Raises as ``config.load_car``.
    """
    folders = [cars] if cars else None
    named = car or os.environ.get("DART_HAL_CAR") or DEFAULT_CAR
    if backend.car_toml is None:
        loaded = load_car(backend.car or named, folders)
        if backend.url.scheme == REPLAY:
            backend.notices += (f"{backend.url.target} holds no files of its car; those of "
                                f"{loaded.config.name} ({loaded.origin}) are used: steering and "
                                "throttle are wrong if it is another car (--car NAME)",)
        return loaded
    url = backend.url.text
    files = (parse_car(backend.car_toml, url, folders) if backend.simulated
             else _of_run(backend, backend.car_toml, folders))
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


def _of_run(backend: Backend, car_toml: str, folders: Folders | None) -> CarFiles:
    """A run outlives the version that wrote it: what this one cannot read becomes a notice."""
    url, measured = backend.url.text, dict(backend.measured)
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
