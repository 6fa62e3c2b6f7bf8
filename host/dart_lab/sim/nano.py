"""Interface of both models of the Nano: the emulated firmware and MockNano."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol


class Nano(Protocol):
    """A Nano in world time; ``now`` [s] is how far it has run."""

    now: float

    def run(self, until: float) -> bool:
        """Advance to ``until``; True = stopped early, right after a 0x00 left the UART."""

    def read(self) -> list[tuple[bytes, float]]:
        """Return bytes that have been sent: (chunk, time of the stop bit of its last byte)."""

    def write(self, data: bytes) -> None:
        """Send bytes from the host, which start now, one per 10 bit times."""

    def set_baud(self, host_baud: float) -> None:
        """Set the rate of the host's side of the line."""

    def set_ring(self, ring: int, marks: Sequence[float]) -> None:
        """Set the edges of ring 0 (A) or 1 (B) as fractions of a gear revolution."""

    def set_wheel(self, rev_per_s: float) -> None:
        """Set the signed rate of the main gear from now on; the phase is continuous."""

    def set_imu(self, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        """Set the true values in sensor axes, in SI units, from now on."""

    def set_pin(self, name: str, level: bool) -> None:
        """Set the level of an input; "D8" is the input capture, D10 to D12 the RC receiver."""

    def set_divider(self, volt: float | None, ohm: float = 7500.0) -> None:
        """Set the voltage [V] at A0 behind a resistance; None: nothing is connected."""

    def gate_capture(self, pin: str) -> None:
        """Connect D8 through a cut-off: low unless the Nano drives "D5" or "D6" high; "": none."""

    def pin_log(self) -> Sequence[tuple[float, str, Any]]:
        """Return edges (t, pin, level) of the outputs since the last call; None = not driven."""

    def reset(self, cause: str = "external") -> None:
        """Reset by "external", "power", "brownout" or "watchdog"."""

    def set_power(self, on: bool) -> None:
        """Switch the supply; without it no pin is driven."""

    def close(self) -> None: ...
