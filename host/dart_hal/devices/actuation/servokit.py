"""Adafruit's ServoKit, unmodified, on a bus of this package.

Importing it imports Blinka (0.2 s) and a ``board`` module that fails on computers unknown to
Blinka. It is therefore imported when a PCA9685 is opened, with an empty ``board`` only where the
real one raises.

The constructor of ServoKit puts the chip to sleep and wakes it with RESTART: a pulse is cut in the
middle, and the pulse of a program that died starts again. The shield between ServoKit and the bus
drops its writes to MODE1 and PRE_SCALE wherever the prescale is already right.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

from dart_hal.core.errors import BusError
from dart_hal.core.ports import Bus
from dart_hal.core.ports.bus import bus_name
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME, NOMINAL_HZ

# Registers.
MODE1 = 0x00
MODE2 = 0x01
PRE_SCALE = 0xFE
# Bit of MODE1.
SLEEP = 0x10
# s until the oscillator runs after SLEEP was cleared (data sheet: 500 us).
WAKE_TIME = 0.0005
# s that ServoKit waits between waking the chip and RESTART.
KIT_WAIT = 0.005

# Attempts to lock the bus, each 0.1 ms: 50 ms, longer than any transaction of this package, and
# than a display of 1 KB at 400 kHz, 23 ms. The guard trips after 100 ms.
MAX_LOCK_ATTEMPTS = 500

_IMPORT_FAILURES = (ImportError, NotImplementedError, AttributeError, RuntimeError, OSError)


class Shield:
    """A bus with the methods of busio that can drop ServoKit's writes to two registers.

    ``keep``: writes to MODE1 and PRE_SCALE of ``address`` are dropped. Without it they pass, and
    ServoKit's wait for the oscillator is repeated in the caller's clock (ServoKit waits in
    wall-clock time).
    """

    def __init__(self, bus: Bus, address: int, keep: bool, sleep: Callable[[float], None]) -> None:
        self.keep = keep
        self.suppressed = 0
        self._bus = bus
        self._address = address
        self._sleep = sleep
        self.unlock = bus.unlock
        self.scan = bus.scan
        self.readfrom_into = bus.readfrom_into
        self.writeto_then_readfrom = bus.writeto_then_readfrom

    def try_lock(self) -> bool:
        """Lock the bus. Raises BusError if it stays locked: ServoKit would wait for ever."""
        lock(self._bus, self._sleep)
        return True

    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None:
        """Pass a write to the bus, or drop it if ``keep`` applies to it."""
        data = bytes(buffer[start:end])
        control = address == self._address and data[:1] in (bytes([MODE1]), bytes([PRE_SCALE]))
        if control and self.keep:
            self.suppressed += 1
            return
        self._bus.writeto(address, data)
        if control and data[0] == MODE1 and not data[-1] & SLEEP:
            self._sleep(KIT_WAIT)


def lock(bus: Bus, sleep: Callable[[float], None]) -> None:
    """Lock a bus. Raises BusError if it stays locked."""
    for _ in range(MAX_LOCK_ATTEMPTS):
        if bus.try_lock():
            return
        sleep(1e-4)
    raise BusError(f"{bus_name(bus)} stays locked by another user of the bus",
                   remedy="end the transaction that locks it")


def load_servokit() -> Any:
    """Import and return the class ``ServoKit``. Raises ImportError if it is not installed."""
    stubs = [name for name in ("board", "busio") if not _imports(name)]
    for name in stubs:
        sys.modules[name] = ModuleType(name)
    try:
        return importlib.import_module("adafruit_servokit").ServoKit
    finally:
        for name in stubs:
            del sys.modules[name]


def make_kit(shield: Shield, address: int, prescale: int) -> Any:
    """Make a ServoKit of 16 channels behind ``shield``. Raises BusError, ValueError (no answer).

    ServoKit assumes the nominal oscillator: the frequency passed is the one for which it then
    computes ``prescale``.
    """
    frequency = NOMINAL_HZ / COUNTS_PER_FRAME / (prescale + 1)
    return load_servokit()(channels=16, i2c=shield, address=address, frequency=frequency)


def _imports(name: str) -> bool:
    """Return whether a module that ServoKit needs can be imported."""
    if "adafruit_servokit" in sys.modules:
        return True
    try:
        importlib.import_module(name)
    except _IMPORT_FAILURES:
        return False
    return True
