"""An I2C bus of the virtual world, in the shape of ``busio.I2C``.

Transactions take wire time: what a host writes at t acts at its STOP, at t + bits / rate, after
transactions that were already on the wire. Every transaction is logged with its times.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from dart_hal.devices.links.busio import TransferBus

GENERAL_CALL = 0x00
SWRST = 0x06


class I2cDevice(Protocol):
    """A device on the bus, such as ``dart_lab.sim.pca9685.Pca9685Model``."""

    def answers(self, address: int) -> bool: ...
    def write(self, data: bytes, acks: Sequence[float], stop: float) -> None: ...
    def read(self, n: int) -> bytes: ...
    def software_reset(self, t: float) -> None: ...


@dataclass(frozen=True, slots=True)
class Transaction:
    """One entry of the log; ``error``: errno, 0 without an error."""

    t_start: float
    t_stop: float
    address: int
    written: bytes
    read: bytes
    error: int = 0


class VirtualBus(TransferBus):
    """I2C bus with devices, wire time, faults and a log.

    Faults: ``nack``: number of coming transactions without an acknowledge; ``stuck``: "sda" or
    "scl", a line that is low. Both raise OSError as Linux does, 121 for a missing acknowledge and
    110 for a stuck line.
    """

    def __init__(self, now: Callable[[], float], devices: Sequence[I2cDevice] = (),
                 rate_hz: float = 100_000.0, log_length: int = 50_000) -> None:
        self.devices = list(devices)
        self.log: deque[Transaction] = deque(maxlen=log_length)
        self.nack = 0
        self.stuck = ""
        self._now = now
        self._bit = 1.0 / rate_hz
        self._free_at = 0.0

    def scan(self) -> list[int]:
        """Return the addresses 0x08..0x77 that acknowledge."""
        if self.stuck:
            return []
        return [a for a in range(0x08, 0x78) if any(d.answers(a) for d in self.devices)]

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """Run one transaction: write ``data``, then read n bytes. Raises OSError 121 or 110."""
        begin = max(self._now(), self._free_at)
        # START, address byte and its ACK: 10 bits. Each data byte with its ACK: 9 bits.
        first = begin + self._bit * 10.0
        if self.stuck:
            self._fail(begin, first, address, data, errno.ETIMEDOUT)
        devices = [d for d in self.devices if d.answers(address)]
        if address == GENERAL_CALL:
            devices = list(self.devices)
        if self.nack > 0 or not devices:
            self.nack = max(0, self.nack - 1)
            self._fail(begin, first, address, data, errno.EREMOTEIO)
        acks = [first + 9.0 * self._bit * (i + 1) for i in range(len(data))]
        # A read after a write needs a repeated START and the address again. STOP: 1 bit.
        restart_bits = 10.0 if n and data else 0.0
        stop = first + self._bit * (9.0 * (len(data) + n) + restart_bits + 1.0)
        for device in devices:
            if address == GENERAL_CALL:
                if data == bytes((SWRST,)):
                    device.software_reset(stop)
            elif data:
                device.write(data, acks, stop)
        answer = devices[0].read(n) if n else b""
        self._log(begin, stop, address, data, answer, 0)
        return answer

    def _fail(self, begin: float, stop: float, address: int, data: bytes, code: int) -> None:
        self._log(begin, stop + self._bit, address, data, b"", code)
        text = "Remote I/O error" if code == errno.EREMOTEIO else "Connection timed out"
        raise OSError(code, text)

    def _log(self, begin: float, stop: float, address: int, data: bytes, answer: bytes,
             code: int) -> None:
        self._free_at = stop
        self.log.append(Transaction(begin, stop, address, data, answer, code))
