"""Adafruit's ServoKit, unmodified, on our bus.

Importing it drags in Blinka (0.2 s) and a ``board`` module that fails on hosts
that Blinka does not know; so it is imported when a PCA9685 is opened, and gets
an empty ``board`` only where the real one raises.

Its constructor puts the chip to sleep and wakes it with RESTART: a pulse is cut
in the middle, and the pulse of a program that died comes back. The shield
between ServoKit and the bus drops its writes to MODE1 and PRE_SCALE wherever
the prescale is right already.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

from dart_hal.core.ports import Bus
from dart_hal.devices.actuation.quantiser import NOMINAL_HZ, STEPS

MODE1, MODE2, PRE_SCALE = 0x00, 0x01, 0xFE
SLEEP = 0x10
WAKE_TIME = 0.0005
"""s until the oscillator runs after SLEEP was cleared (data sheet: 500 us)."""
KIT_WAIT = 0.005
"""s that ServoKit waits between waking the chip and RESTART."""

_IMPORT_FAILURES = (ImportError, NotImplementedError, AttributeError, RuntimeError, OSError)


class Shield:
    """A busio-shaped bus that can keep ServoKit's hands off two registers.

    ``keep``: writes to MODE1 and PRE_SCALE of ``address`` are dropped. Without
    it they pass, and ServoKit's wait for the oscillator is repeated in the
    caller's clock (its own is in wall-clock time).
    """

    def __init__(self, bus: Bus, address: int, keep: bool, sleep: Callable[[float], None]) -> None:
        self.keep = keep
        self.suppressed = 0
        self._bus, self._address, self._sleep = bus, address, sleep
        self.try_lock, self.unlock, self.scan = bus.try_lock, bus.unlock, bus.scan
        self.readfrom_into = bus.readfrom_into
        self.writeto_then_readfrom = bus.writeto_then_readfrom

    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None:
        """Pass a write on, unless it is one of those that are kept away."""
        data = bytes(buffer[start:end])
        control = address == self._address and data[:1] in (bytes([MODE1]), bytes([PRE_SCALE]))
        if control and self.keep:
            self.suppressed += 1
            return
        self._bus.writeto(address, data)
        if control and data[0] == MODE1 and not data[-1] & SLEEP:
            self._sleep(KIT_WAIT)


def load_servokit() -> Any:
    """The class ``ServoKit``. Raises ImportError when it is not installed."""
    stubs = [name for name in ("board", "busio") if not _imports(name)]
    for name in stubs:
        sys.modules[name] = ModuleType(name)
    try:
        return importlib.import_module("adafruit_servokit").ServoKit
    finally:
        for name in stubs:
            del sys.modules[name]


def make_kit(shield: Shield, address: int, prescale: int) -> Any:
    """A ServoKit of 16 channels behind ``shield``. Raises BusError, ValueError (no answer).

    It takes the oscillator for the nominal one, and is given the frequency that leads to
    ``prescale`` by that.
    """
    frequency = NOMINAL_HZ / STEPS / (prescale + 1)
    return load_servokit()(channels=16, i2c=shield, address=address, frequency=frequency)


def _imports(name: str) -> bool:
    if "adafruit_servokit" in sys.modules:
        return True
    try:
        importlib.import_module(name)
    except _IMPORT_FAILURES:
        return False
    return True
