"""Foxglove's live protocol: an open car's channels for Foxglove, Lichtblick and the like.

    from dart_lab.live.foxglove.server import serve

    with serve(car):        # ws://localhost:8765
        ...

Read-only: no client can move the car.
"""

from __future__ import annotations

from pathlib import Path

LAYOUT = Path(__file__).with_name("layout.json")
"""A layout to import: path, speed, yaw rate, commands against what the pins carry."""
