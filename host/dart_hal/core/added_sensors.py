"""Lidars, cameras and sources of poses that other packages add.

An entry point of the group ``dart_hal.sensors`` is a function ``open(url: str)``. Its name is the
kind and the URL scheme: ``lidar.acme`` opens ``--lidar acme://...``.
"""

from __future__ import annotations

from typing import Any

from dart_hal.core.errors import PluginFailed
from dart_hal.core.plugins import attribute_errors, describe, list_plugins, load_entry

SENSOR_GROUP = "dart_hal.sensors"


def list_schemes(kind: str) -> list[str]:
    """Return the URL schemes that other packages add for ``lidar``, ``camera`` or ``poses``."""
    return [f"{scheme}:" for found, _, scheme in (name.partition(".")
            for name in list_plugins(SENSOR_GROUP)) if found == kind]


def open_added_sensor(kind: str, url: str) -> Any | None:
    """Open the sensor of a URL if another package adds its scheme, else return None.

    kind: ``lidar``, ``camera`` or ``poses``. Raises PluginFailed for an object without ``poll`` and
    ``close``, and for errors of the other package that are none of the catalogue.
    """
    entry = list_plugins(SENSOR_GROUP).get(f"{kind}.{url.partition(':')[0]}")
    if entry is None:
        return None
    opener = load_entry(entry)
    with attribute_errors(entry):
        source = opener(url)
    if not (callable(getattr(source, "poll", None)) and callable(getattr(source, "close", None))):
        raise PluginFailed(f"{describe(entry)} returned no sensor", found=type(source).__name__,
                           expected="an object with poll(now) and close()")
    return source
