"""The voltage of the battery: read at a low rate, a warning, and a limit of the throttle.

An INA219 is read right after the pulses of a PWM frame have been written, so that the bus is free
again before the next ones. On a real bus a thread does it, over a connection of its own. A divider
at the Nano is read by the Nano.

Four readings in a row, one second, must be below a threshold: an acceleration alone is no empty
battery. The limit ends ``RELEASE_MARGIN`` per cell above its threshold, again for four readings,
because the voltage rises when the throttle is limited.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Iterable, Mapping
from math import isnan, nan
from typing import Any

from dart_hal.core.config.car import BatteryConfig
from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import Bus
from dart_hal.core.ports.bus import bus_name, explain
from dart_hal.devices.battery.divider import decode_divider
from dart_hal.devices.battery.ina219 import (
    BUS_VOLTAGE,
    check_ina219,
    decode_voltage,
    is_plausible,
    read_register,
)
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.i2c import SocketBus, open_bus
from dart_hal.devices.links.smbus import SmbusBus

# s between two readings: four decide within a second, and one PWM frame of twelve has a reading.
READ_INTERVAL = 0.25
# s after which a reading no longer counts: three in a row have failed.
MAX_READING_AGE = 1.0
# Readings in a row that decide: one second, longer than an acceleration at full throttle.
DECIDING_READINGS = 4
# V per cell above the threshold of the limit at which it ends: more than the sag of a pack of two
# cells with 50 mohm at 8 A, 0.2 V per cell.
RELEASE_MARGIN = 0.2

log = logging.getLogger("dart_hal")


class BatteryLimit:
    """Decides from the readings whether to warn and whether to limit the throttle.

    low: a warning is due; limited: the throttle is limited.
    """

    def __init__(self, config: BatteryConfig) -> None:
        self.low = False
        self.limited = False
        self._config = config
        self._newest: deque[float] = deque(maxlen=DECIDING_READINGS)

    def add(self, voltage: float) -> None:
        """Add a reading [V]."""
        self._newest.append(voltage / self._config.cells)
        if len(self._newest) < DECIDING_READINGS:
            return
        highest = max(self._newest)
        self.low = self.low or highest < self._config.warn_cell
        if highest < self._config.limit_cell:
            self.limited = True
        elif min(self._newest) > self._config.limit_cell + RELEASE_MARGIN:
            self.limited = False


class BatteryWatch:
    """Turns the readings of a source into the warning and the limit; base of the sources.

    voltage [V]: newest reading, None: no sensor, or it does not answer; cap: largest forward
    throttle while the battery is low, else None; trouble: why there is no voltage.
    """

    def __init__(self, config: BatteryConfig) -> None:
        self.voltage: float | None = None
        self.cap: float | None = None
        self.trouble: DartHalError | None = None
        self._config = config
        self._limit = BatteryLimit(config)
        self._warned = False
        self._lost = False
        self._due_at = float("-inf")
        self._read_at = float("-inf")
        # Result of a reading that ``update`` has not taken over: V, or an error.
        self._result: float | DartHalError | None = None

    def update(self, now: float) -> float | None:
        """Take over a finished reading and start the next one; call it after a PWM frame.

        Returns the new voltage [V], NaN if it has just been lost, None without news.
        """
        before = self.voltage
        result = self._read(now)
        if result is not None:
            self._take(result, now)
        if self.voltage is not None and now - self._read_at > MAX_READING_AGE:
            self.voltage = None
        if self.voltage is None:
            return None if before is None else nan
        return self.voltage if result is not None else None

    def close(self) -> None:
        """End the readings."""

    def _read(self, now: float) -> float | DartHalError | None:
        """Return a reading [V] or its error if one is finished; start the next one if it is due."""
        raise NotImplementedError

    def _take(self, result: float | DartHalError, now: float) -> None:
        """Take over a reading or an error; report each loss and the low battery once."""
        if isinstance(result, DartHalError):
            self.voltage = None
            self.trouble = result
            if not self._lost:
                self._lost = True
                log.warning("no battery voltage: %s", result)
            return
        self.voltage = result
        self.trouble = None
        self._lost = False
        self._read_at = now
        self._limit.add(result)
        config = self._config
        if self._limit.low and not self._warned:
            self._warned = True
            log.warning("the battery is low: %.2f V, %.2f V per cell, below %g V: charge it soon",
                        result, result / config.cells, config.warn_cell)
        cap = config.limited_throttle if self._limit.limited else None
        if cap is not None and self.cap is None:
            log.warning("the battery is empty: below %g V per cell; the throttle is limited to %g",
                        config.limit_cell, cap)
        self.cap = cap


class BatteryMonitor(BatteryWatch):
    """Reads the INA219 of an open car."""

    def __init__(self, backend: Backend, config: BatteryConfig) -> None:
        assert backend.bus is not None
        super().__init__(config)
        self._spec = None if backend.virtual else backend.url.options.get("i2c")
        self._shared: Bus = backend.bus
        self._bus: Bus | None = None
        self._checked = False
        self._request = threading.Event()
        self._closed = False
        self._thread: threading.Thread | None = None
        if not backend.virtual:
            self._thread = threading.Thread(target=self._run, name="battery", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread; it is not waited for longer than a reading takes."""
        self._closed = True
        self._request.set()
        if self._thread is not None:
            self._thread.join(timeout=0.1)

    def _read(self, now: float) -> float | DartHalError | None:
        result = self._result
        self._result = None
        if now >= self._due_at:
            self._due_at = now + READ_INTERVAL
            if self._thread is None:
                return self._measure()
            self._request.set()
        return result

    def _measure(self) -> float | DartHalError:
        """Read the voltage [V]; the first time, check which device answers."""
        address = self._config.address
        try:
            if self._bus is None:
                # A connection of its own: the kernel separates whole transactions.
                self._bus = self._shared if self._spec is None else open_bus(self._spec)
            if not self._checked:
                check_ina219(self._bus, address, self._config.cells)
                self._checked = True
            voltage = decode_voltage(read_register(self._bus, address, BUS_VOLTAGE))
        except DartHalError as error:
            return error
        except OSError as error:
            return explain(error, address, bus_name(self._bus or self._shared))
        if voltage is None or not is_plausible(voltage, self._config.cells):
            # Another chip, or a battery that was unplugged: check again.
            self._checked = False
            return explain(OSError(f"no voltage of a battery: {voltage} V"), address,
                           bus_name(self._bus))
        return voltage

    def _run(self) -> None:
        """Read when requested; body of the thread."""
        while True:
            self._request.wait()
            self._request.clear()
            if self._closed:
                break
            self._result = self._measure()
        if self._spec is not None and isinstance(self._bus, SocketBus | SmbusBus):
            self._bus.close()


class DividerBattery(BatteryWatch):
    """Takes the voltage at A0 of the Nano from its messages BATTERY."""

    def add(self, values: Mapping[str, Any], t: float) -> None:
        """Take over the message BATTERY that arrived at host time ``t`` [s]."""
        assert self._config.ratio is not None
        self._result = decode_divider(values, self._config.ratio, self._config.cells)

    def _read(self, now: float) -> float | DartHalError | None:
        result = self._result
        if result is None or now < self._due_at:
            return None
        self._due_at = now + READ_INTERVAL
        self._result = None
        return result


class RecordedBattery:
    """The voltages of a recording, in the place of a ``BatteryWatch``."""

    def __init__(self, readings: Iterable[tuple[float, float]]) -> None:
        self.voltage: float | None = None
        self._readings = deque(readings)

    def reach(self, t: float) -> None:
        """Take over the readings that were made before ``t`` [s]."""
        while self._readings and self._readings[0][0] < t:
            voltage = self._readings.popleft()[1]
            self.voltage = None if isnan(voltage) else voltage
