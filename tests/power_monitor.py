"""A power monitor with 16-bit registers at the PCA9685's address, as some computers have one.

INA3221 and its kin (data sheet SBOS576B): a write sets the pointer, two more
bytes store a register; a read gives its high byte, its low byte, and so on.
"""

from __future__ import annotations

from collections.abc import Sequence

# Configuration, shunt and bus voltages of a running computer, manufacturer and die id.
_POWER_ON = {0x00: 0x7127, 0x01: 0x0128, 0x02: 0x1388, 0x03: 0x00F0, 0x04: 0x1390, 0x05: 0x0010,
             0x06: 0x0D20, 0xFE: 0x5449, 0xFF: 0x3220}


class PowerMonitor:
    """One monitor at ``address``; ``stored``: list of writes (register, value)."""

    def __init__(self, address: int = 0x40, registers: dict[int, int] | None = None) -> None:
        self.address = address
        self.stored: list[tuple[int, bytes]] = []
        self._registers = dict(_POWER_ON if registers is None else registers)
        self._pointer = 0

    def answers(self, address: int) -> bool:
        """Return whether the address is the monitor's own."""
        return address == self.address

    def write(self, data: bytes, acks: Sequence[float], stop: float) -> None:
        """Set the pointer to the first byte; store further bytes in the register."""
        if data:
            self._pointer = data[0]
        if len(data) > 1:
            self.stored.append((data[0], data[1:]))
            self._registers[data[0]] = int.from_bytes(data[1:3].ljust(2, b"\0"), "big")

    def read(self, n: int) -> bytes:
        """Return n bytes of the register at the pointer, high byte first, repeatedly."""
        pair = self._registers.get(self._pointer, 0).to_bytes(2, "big")
        return (pair * (n // 2 + 1))[:n]

    def software_reset(self, t: float) -> None:
        """Do nothing: the monitor ignores the general call."""
