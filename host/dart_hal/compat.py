"""Old paths and names, kept for one version with a DeprecationWarning.

``import dart_hal.sim`` imports ``dart_lab.sim`` and gives the same module under both names. Strings
here are the only way in which this package reaches ``dart_lab``.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

MOVED = {
    # one module
    "dart_hal.identify.runs": "dart_hal.car.runs",
    "dart_hal.identify.run_poses": "dart_hal.car.run_poses",
    "dart_hal.identify.curves": "dart_hal.calibration.curves",
    "dart_hal.identify.submodels.groups": "dart_hal.calibration.sessions",
    "dart_hal.identify.submodels.samples": "dart_hal.calibration.samples",
    "dart_hal.identify.submodels.sessions": "dart_hal.calibration.sessions",
    "dart_hal.identify.submodels.steering_map": "dart_hal.calibration.steering_map",
    "dart_hal.estimation.clock": "dart_hal.core.clock_fit",
    "dart_hal.report.figures": "dart_hal.core.figures",
    # a package with all that is in it
    "dart_hal.actuation": "dart_hal.devices.actuation",
    "dart_hal.bridges": "dart_lab.live.ros",
    "dart_hal.camera": "dart_hal.devices.camera",
    "dart_hal.config": "dart_hal.core.config",
    "dart_hal.diagnose": "dart_lab.diagnosis",
    "dart_hal.errors": "dart_hal.core.errors",
    "dart_hal.evaluate": "dart_lab.identification.evaluation",
    "dart_hal.experiment": "dart_lab.identification.experiment",
    "dart_hal.fitting": "dart_hal.vehicle.fitting",
    "dart_hal.foxglove": "dart_lab.live.foxglove",
    "dart_hal.identify": "dart_lab.identification",
    "dart_hal.lidar": "dart_hal.devices.lidar",
    "dart_hal.links": "dart_hal.devices.links",
    "dart_hal.localisation": "dart_hal.estimation.localisation",
    "dart_hal.mapping": "dart_hal.estimation.mapping",
    "dart_hal.notebook": "dart_hal.core.notebook",
    "dart_hal.paper": "dart_lab.identification.paper",
    "dart_hal.ports": "dart_hal.core.ports",
    "dart_hal.poses": "dart_hal.devices.poses",
    "dart_hal.predict": "dart_lab.identification.prediction",
    "dart_hal.process": "dart_hal.core.process",
    "dart_hal.report": "dart_lab.report",
    "dart_hal.sim": "dart_lab.sim",
    "dart_hal.text_file": "dart_hal.core.text_file",
    "dart_hal.types": "dart_hal.core.types",
    "dart_hal.view": "dart_lab.live.view",
}
MOVED_NAMES = {  # module and name: new module and name
    ("dart_hal.recording", "to_dataframe"): ("dart_hal.car.table", "to_dataframe"),
    ("dart_lab.diagnosis.inputs", "checked"): ("dart_lab.diagnosis.inputs", "check_inputs"),
}

MOVED_MEMBERS = {  # of Car: new path, what it was without that device
    "camera_health": ("camera.health", None),
    "camera_trouble": ("camera.trouble", None),
    "end_recording": ("recorder.end", None),
    "images": ("camera.images", tuple),
    "lidar_health": ("lidar.health", None),
    "lidar_silent": ("lidar.located", False),
    "lidar_trouble": ("lidar.trouble", None),
    "logged": ("recorder.logged", None),
    "messages": ("recorder.messages", None),
    "recording": ("recorder.path", None),
    "recording_trouble": ("recorder.trouble", None),
    "scans": ("lidar.scans", tuple),
    "start_recording": ("recorder.start", None),
}


def find_new_path(old: str) -> str | None:
    """Return where a module of version 0.1 is now; None if it has not moved.

    >>> find_new_path("dart_hal.sim.light")
    'dart_lab.sim.light'
    """
    parts = old.split(".")
    for n in range(len(parts), 1, -1):
        new = MOVED.get(".".join(parts[:n]))
        if new is not None:
            return ".".join([new, *parts[n:]])
    return None


def load_moved_name(module: str, name: str) -> Any:
    """Return a name that a module had in version 0.1. Raises AttributeError for any other."""
    if (module, name) not in MOVED_NAMES:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")
    new_module, new_name = MOVED_NAMES[module, name]
    _warn(f"{module}.{name}", f"{new_module}.{new_name}", 4)
    return getattr(import_module(new_module), new_name)


def load_moved_member(car: Any, name: str) -> Any:
    """Return a member that a car had in version 0.1. Raises AttributeError for any other."""
    if name not in MOVED_MEMBERS:
        raise AttributeError(f"a car has no attribute {name!r}")
    path, without = MOVED_MEMBERS[name]
    _warn(f"car.{name}", f"car.{path}", 4)
    part, _, member = path.partition(".")
    there = {"camera": car.has_camera, "lidar": car.has_lidar, "recorder": True}[part]
    return getattr(getattr(car, part), member) if there else without


class RenamedMethod:
    """Gives a method of version 0.2 under its old name: ``at = RenamedMethod("predict")``."""

    def __init__(self, new: str) -> None:
        self._new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self._owner = owner.__name__
        self._old = name

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        if instance is None:
            return self
        _warn(f"{self._owner}.{self._old}", f"{self._owner}.{self._new}", 3, "0.3")
        return getattr(instance, self._new)


def accept_old_keyword(old: str, new: str) -> Callable[
        [Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Make a function accept a parameter by the name that it had in version 0.2, too."""
    def decorate(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        @wraps(function)
        def call(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            if old in kwargs and new not in kwargs:
                name = function.__qualname__
                _warn(f"{name}({old}=...)", f"{name}({new}=...)", 3, "0.3")
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)
        return call
    return decorate


def _warn(old: str, new: str, level: int, version: str = "0.2") -> None:
    """Warn where a program uses an old path or name: ``level`` calls above."""
    warnings.warn(f"{old} is {new} since version {version}", DeprecationWarning,
                  stacklevel=level)


class _NewModule:
    """Puts the module at its new path under its old name, too."""

    def __init__(self, new: str) -> None:
        self._new = new

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        sys.modules[module.__name__] = import_module(self._new)


class MovedModules:
    """Finds modules by their paths of version 0.1.

    It is asked first: a moved package is under its old name, too, and its modules would be loaded
    a second time from there.
    """

    def find_spec(self, fullname: str, path: Sequence[str] | None,
                  target: ModuleType | None = None) -> ModuleSpec | None:
        new = find_new_path(fullname)
        if new is None:
            return None
        _warn(fullname, new, 3)
        loader: Any = _NewModule(new)  # no importlib.abc.Loader, which takes long to import
        return ModuleSpec(fullname, loader, is_package=True)


def install() -> None:
    """Let Python find modules by their old paths."""
    if not any(isinstance(finder, MovedModules) for finder in sys.meta_path):
        sys.meta_path.insert(0, MovedModules())
