"""Load the entry points of installed packages: backends, viewers, transports, verbs."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dart_hal.core.errors import DartHalError, PluginFailed, UsageError

if TYPE_CHECKING:  # takes a tenth of the import of a car
    from importlib.metadata import EntryPoint

OWN_DISTRIBUTION = "dart-hal"


def list_plugins(group: str) -> dict[str, EntryPoint]:
    """List the entry points of a group by name."""
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group=group)}


def load_plugin(group: str, name: str) -> Any:
    """Load the object behind an entry point.

    Raises UsageError if no installed package offers it, or if it lacks a Python package. The error
    names the command that installs that package for this interpreter. Raises PluginFailed if the
    module of another package cannot be imported for another reason.
    """
    known = list_plugins(group)
    if name not in known:
        raise UsageError(f"no installed package offers {name!r} under {group}",
                         found=", ".join(sorted(known)) or "none",
                         expected=f"an entry point {name} of {group}",
                         remedy="make setup, or install dart-hal again")
    return load_entry(known[name])


def load_entry(entry: EntryPoint) -> Any:
    """Load the object behind an entry point that is known. Raises UsageError, PluginFailed."""
    try:
        with attribute_errors(entry):
            return entry.load()
    except ImportError as why:
        from dart_hal.core.process.extras import missing_module_error

        package = (why.name or entry.name).partition(".")[0]
        raise missing_module_error(package, entry.name) from why


@contextmanager
def attribute_errors(entry: EntryPoint) -> Iterator[None]:
    """Turn an error of another package's entry point into PluginFailed, which names that package.

    Errors of the catalogue pass: they state their cause already. So do errors of this
    distribution, a missing Python package and exhausted memory.
    """
    try:
        yield
    except (DartHalError, ImportError, MemoryError):
        raise
    except Exception as error:
        if is_own(entry):
            raise
        raise PluginFailed(f"{describe(entry)} failed: {type(error).__name__}: {error}",
                           found=locate(error)) from error


def is_own(entry: EntryPoint) -> bool:
    """Whether this distribution offers the entry point."""
    return entry.dist is not None and entry.dist.name.replace("_", "-") == OWN_DISTRIBUTION


def describe(entry: EntryPoint) -> str:
    """Name an entry point and its distribution.

    >>> from importlib.metadata import EntryPoint
    >>> describe(EntryPoint("tcp", "tcp_nano:open_tcp", "dart_hal.backends"))
    'tcp = tcp_nano:open_tcp (dart_hal.backends) of an unknown distribution'
    """
    owner = ("an unknown distribution" if entry.dist is None
             else f"{entry.dist.name} {entry.dist.version}")
    return f"{entry.name} = {entry.value} ({entry.group}) of {owner}"


def locate(error: BaseException) -> str:
    """Return file and line that raised the error."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{Path(frame.filename).name}, line {frame.lineno}"
