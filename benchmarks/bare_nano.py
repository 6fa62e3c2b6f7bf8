"""The firmware alone in the emulator: no car around it, no HAL, only its frames."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType

from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.frame import WireFrame
from dart_lab.sim.eeprom import make_eeprom
from dart_lab.sim.ring import GEAR_REVOLUTION, even_ring

BOOTED = 2.0
"""s after which firmware and IMU are up."""


class BareNano:
    """An emulated Nano with even rings of ``edges`` per revolution, and a decoder.

    ``params`` differ from the firmware's defaults. Raises EmulatorMissing.
    """

    def __init__(self, edges: tuple[int, int] = (20, 0),
                 params: Mapping[str, int] | None = None, clock_error: float = 0.0) -> None:
        self.nano = EmulatedNano(eeprom=make_eeprom(1, params), clock_error=clock_error)
        self.decoder = FrameDecoder(UP)
        self.bytes = 0
        for ring, n in enumerate(edges):
            self.nano.set_ring(ring, even_ring(n).edges)

    def __enter__(self) -> BareNano:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.nano.close()

    def roll(self, metres_per_second: float) -> None:
        """Turn the main gear as it turns at that speed of the car [m/s]."""
        self.nano.set_wheel(metres_per_second / GEAR_REVOLUTION)

    def run(self, seconds: float, tick: float = 0.01) -> list[tuple[WireFrame, float]]:
        """Frames of the next ``seconds`` with the times of their last stop bits [s]."""
        frames: list[tuple[WireFrame, float]] = []
        nano, begin = self.nano, self.nano.now
        for k in range(1, max(1, round(seconds / tick)) + 1):
            running = True
            while running:
                running = nano.run(begin + k * tick)
                for data, t in nano.read():
                    self.bytes += len(data)
                    frames += [(frame, t) for frame in self.decoder.feed(data)]
        return frames
