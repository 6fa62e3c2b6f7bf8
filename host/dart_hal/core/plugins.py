"""What installed packages offer by entry points: backends, viewers, transports, verbs."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command


def list_plugins(group: str) -> dict[str, EntryPoint]:
    """List the entry points of a group by name."""
    return {entry.name: entry for entry in entry_points(group=group)}


def load_plugin(group: str, name: str) -> Any:
    """Load the object behind an entry point.

    Raises UsageError if no installed package offers it, or if it lacks a Python package. The error
    names the command that installs that package for this interpreter.
    """
    known = list_plugins(group)
    if name not in known:
        raise UsageError(f"no installed package offers {name!r} under {group}",
                         found=", ".join(sorted(known)) or "none",
                         expected=f"an entry point {name} of {group}",
                         remedy="make setup, or install dart-hal again")
    try:
        return known[name].load()
    except ImportError as why:
        package = (why.name or name).partition(".")[0]
        raise UsageError(f"{name} needs the Python package {package}",
                         found=f"{package} is not installed",
                         remedy=install_command(package)) from why
