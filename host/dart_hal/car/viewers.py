"""Viewers of an open car, which installed packages offer under ``dart_hal.viewers``."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command

GROUP = "dart_hal.viewers"


def open_viewer(name: str, car: object, options: dict[str, Any]) -> Any:
    """What the viewer of this name opens for a car. Raises UsageError where there is none, or where
    it lacks a package."""
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in known:
        raise UsageError(f"there is no viewer {name!r}", found=", ".join(sorted(known)) or "none",
                         expected=f"an entry point of {GROUP}",
                         remedy="make setup, or install dart-hal again")
    try:
        opened = known[name].load()
    except ImportError as why:
        raise UsageError(f"a live page needs {why.name}", found=f"{why.name} is not installed",
                         remedy=install_command(why.name or "websockets")) from why
    return opened(car, **options)
