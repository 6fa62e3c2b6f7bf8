"""Viewers of a car, of a room of cars or of a file, offered under ``dart_hal.viewers``."""

from __future__ import annotations

from typing import Any

from dart_hal.core.plugins import load_plugin

GROUP = "dart_hal.viewers"
PORT = 8642  # where pages are served; a bookmark in a browser keeps to it


def open_viewer(name: str, shown: object, **options: Any) -> Any:
    """Open the viewer of this name. Raises UsageError if there is none or it lacks a package."""
    return load_plugin(GROUP, name)(shown, **options)
