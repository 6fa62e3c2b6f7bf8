"""Viewers of a car, of a room of cars or of a file: entry points of ``dart_hal.viewers``."""

from __future__ import annotations

from typing import Any

from dart_hal.core.plugins import load_plugin

VIEWER_GROUP = "dart_hal.viewers"
# TCP port of the pages; fixed, so that a bookmark in a browser stays valid.
VIEWER_PORT = 8642


def open_viewer(name: str, shown: object, **options: Any) -> Any:
    """Open the viewer of this name. Raises UsageError if it does not exist or lacks a package."""
    return load_plugin(VIEWER_GROUP, name)(shown, **options)
