"""A battery and its INA219, or its divider at the Nano, in the virtual world.

    V = cells (V_empty + (V_full - V_empty) q) - R I,    I = I_0 + I_max |throttle|,    dq/dt = -I/C

A straight line from 3.3 to 4.2 V per cell over the charge q is a rough shape of a lithium cell
between 5 and 100 %. The motor of the world does not become weaker: ``effect=battery_fade`` does
that, by this voltage. Its parameters hold at the nominal voltage of the pack, if the vehicle of the
world states no motor_voltage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dart_hal.core.errors import UsageError

if TYPE_CHECKING:
    from dart_lab.sim.world import World

INA219_ADDRESS = 0x41
# Configuration after power-on, and its register with those of voltage and calibration.
POWER_ON_CONFIGURATION = 0x399F
# V of a cell without and with its full charge.
EMPTY_CELL = 3.3
FULL_CELL = 4.2
CELLS = 2
# V of the pack by its label, 3.7 V per cell.
NOMINAL_VOLTAGE = 3.7 * CELLS
# Divider of 20 and 10 kohm: ratio, and the resistance that A0 has to both [ohm].
DIVIDER_RATIO = 3.0
DIVIDER_OHM = 20e3 / 3.0
# s between two steps of the charge.
BATTERY_STEP = 0.02
_RANGE = {"charge": (-0.2, 1.0), "resistance": (0.0, 1.0), "rest_current": (0.0, 10.0),
          "motor_current": (0.0, 100.0), "capacity": (0.001, 100.0)}


@dataclass(frozen=True, slots=True)
class BatteryParams:
    """Parameters: charge of the start (0 to 1); resistance [ohm]; rest_current [A] of computer and
    boards; motor_current [A] at full throttle; capacity [Ah]; at_nano: measured by a divider at
    the Nano instead of an INA219."""

    charge: float = 0.8
    resistance: float = 0.04
    rest_current: float = 1.0
    motor_current: float = 15.0
    capacity: float = 4.0
    at_nano: bool = False


def parse_battery(text: str) -> BatteryParams | None:
    """Parse ``battery=...`` of a URL: 1, ``charge=0.2,...`` or ``nano,charge=0.2``.

    Returns None for a car that does not measure its battery. Raises UsageError.
    """
    if text in ("0", "none"):
        return None
    given: dict[str, float] = {}
    parts = text.split(",")
    at_nano = parts[0] == "nano"
    for part in parts[1:] if at_nano or text == "1" else parts:
        name, _, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        low, high = _RANGE.get(name, (1.0, 0.0))
        if name in given or not low <= number <= high:
            ranges = ", ".join(f"{n} {a:g} to {b:g}" for n, (a, b) in _RANGE.items())
            raise UsageError(f"battery={text} is not understood", found=part,
                             expected=f"1, or NAME=NUMBER,... once each, of {ranges}; "
                                      "nano first for a divider at the Nano")
        given[name] = number
    return BatteryParams(**given, at_nano=at_nano)


class SimBattery:
    """The pack: its charge follows the current of the world's ESC."""

    def __init__(self, world: World, params: BatteryParams) -> None:
        self.charge = params.charge
        self._world = world
        self._params = params
        world.schedule(0.0, self._step)

    @property
    def current(self) -> float:
        """Return the present current [A]."""
        p = self._params
        return p.rest_current + p.motor_current * abs(self._world.esc.throttle)

    @property
    def voltage(self) -> float:
        """Return the present voltage [V]."""
        open_circuit = CELLS * (EMPTY_CELL + (FULL_CELL - EMPTY_CELL) * self.charge)
        return open_circuit - self._params.resistance * self.current

    def _step(self, world: World) -> None:
        self.charge -= self.current * BATTERY_STEP / (3600.0 * self._params.capacity)
        world.schedule(world.t + BATTERY_STEP, self._step)


class SimDivider:
    """The divider of the pack at A0 of the Nano; connected False: its wire is off."""

    def __init__(self, battery: SimBattery, world: World) -> None:
        self.battery = battery
        self.connected = True
        world.schedule(0.0, self._step)

    def _step(self, world: World) -> None:
        volt = self.battery.voltage / DIVIDER_RATIO if self.connected else None
        world.nano.set_divider(volt, DIVIDER_OHM)
        world.schedule(world.t + BATTERY_STEP, self._step)


class Ina219Model:
    """Registers of an INA219 as ``dart_lab.sim.bus.I2cDevice``; absent: it does not answer."""

    def __init__(self, battery: SimBattery, address: int = INA219_ADDRESS) -> None:
        self.battery = battery
        self.address = address
        self.absent = False
        self.configuration = POWER_ON_CONFIGURATION
        self.written: list[bytes] = []
        self._pointer = 0

    def answers(self, address: int) -> bool:
        """Return whether the chip acknowledges."""
        return address == self.address and not self.absent

    def write(self, data: bytes, acks: Sequence[float], stop: float) -> None:
        """Set the pointer; further bytes would be written to the register and are noted."""
        self._pointer = data[0]
        if len(data) > 1:
            self.written.append(data)

    def read(self, n: int) -> bytes:
        """Return n bytes of the register at the pointer, which stays there."""
        counts = max(round(self.battery.voltage / 4e-3), 0)
        value = {0x00: self.configuration, 0x02: counts << 3 | 2}.get(self._pointer, 0)
        return (value.to_bytes(2, "big") * (n // 2 + 1))[:n]

    def software_reset(self, t: float) -> None:
        """Ignore the general call, as the chip does."""
