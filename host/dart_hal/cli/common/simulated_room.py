"""Interface of an installed simulator: the map of its room and the true path of its car."""

from __future__ import annotations

from typing import Protocol

from dart_hal.core.plugins import load_plugin
from dart_hal.core.types import FloatArray
from dart_hal.devices.links.base import Backend
from dart_hal.estimation.localisation.field import Map


class Simulator(Protocol):
    """A module under the entry points ``dart_hal.simulators``, by the scheme of its URLs."""

    def map_of_room(self, backend: Backend) -> Map:
        """Return the map of the room in which the simulated lidar is."""

    def true_path(self, backend: Backend, t: FloatArray) -> FloatArray:
        """Return x, y [m], yaw [rad] (n, 3) in the room at times t (n,) [s]."""


def load_simulator(scheme: str = "sim") -> Simulator:
    """Load the simulator behind a scheme. Raises UsageError if none is installed."""
    simulator: Simulator = load_plugin("dart_hal.simulators", scheme)
    return simulator
