"""The shape that both Nanos have: the emulated firmware and MockNano."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol


class Nano(Protocol):
    """A Nano in world time; ``now`` [s] is how far it has run."""

    now: float

    def run(self, until: float) -> bool:
        """Advance to ``until``; True = stopped early, right after a 0x00 left the UART."""

    def read(self) -> list[tuple[bytes, float]]:
        """Bytes whose stop bit is on the wire: (chunk, time of its last byte)."""

    def write(self, data: bytes) -> None:
        """Bytes from the host; they start now, one per 10 bit times."""

    def set_baud(self, host_baud: float) -> None:
        """Rate of the host's side of the line."""

    def set_ring(self, ring: int, marks: Sequence[float]) -> None:
        """Edges of ring 0 (A) or 1 (B) as fractions of a gear revolution."""

    def set_wheel(self, rev_per_s: float) -> None:
        """Signed rate of the main gear from now on, phase continuous."""

    def set_imu(self, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        """True values in sensor axes, SI, from now on."""

    def set_pin(self, name: str, level: bool) -> None:
        """Level of an input; "D8" is the input capture."""

    def capture_behind_mux(self, on: bool) -> None:
        """D8 gets its level through a multiplexer: low unless the Nano drives D5 high."""

    def pin_log(self) -> Sequence[tuple[float, str, Any]]:
        """Edges (t, pin, level) of the outputs since the last call; None = not driven."""

    def reset(self, cause: str = "external") -> None:
        """"external", "power", "brownout" or "watchdog"."""

    def set_power(self, on: bool) -> None:
        """The supply comes and goes; without it nothing is driven."""

    def close(self) -> None: ...
