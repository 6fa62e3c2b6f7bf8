"""Foxglove's live protocol: serve the channels of an open car to Foxglove or Lichtblick.

    from dart_lab.live.foxglove.server import serve

    with serve(car):        # ws://localhost:8765
        ...

Read-only: no client can move the car.
"""

from __future__ import annotations

from pathlib import Path

# Layout to import: path, speed, yaw rate, commands compared with the pulses at the pins.
LAYOUT = Path(__file__).with_name("layout.json")
