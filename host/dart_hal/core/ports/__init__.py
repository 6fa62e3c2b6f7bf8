"""Protocols of external devices: I2C bus, link to a Nano, clock, poses, lidar, camera, operator.

Code that drives, records or simulates a car depends on these protocols. The implementations are in
higher layers.
"""

from dart_hal.core.ports.bus import Bus
from dart_hal.core.ports.devices import DeviceSource, ImageSource, ScanSource
from dart_hal.core.ports.link import Chunk, Clock, Link
from dart_hal.core.ports.poses import PoseSource
from dart_hal.core.ports.workshop import Workshop

__all__ = ["Bus", "Chunk", "Clock", "DeviceSource", "ImageSource", "Link", "PoseSource",
           "ScanSource", "Workshop"]
