"""Bus voltage of an INA219 of Texas Instruments, read without a write to its registers.

The chip has registers of 16 bits, the most significant byte first (data sheet, section 8.6):

    0x00 configuration   bit 15 reset and bit 14 read as 0; 0x399F after power-on
    0x02 bus voltage     bits 15 to 3 in 4 mV; bit 2 reads as 0; bit 1 ready, bit 0 overflow
    0x05 calibration     bit 0 reads as 0

It measures all the time after power-on. No register identifies it, so that a device is taken for
an INA219 only if these bits and the voltage are right.
"""

from __future__ import annotations

from dart_hal.core.errors import BusError
from dart_hal.core.ports import Bus

CONFIGURATION = 0x00
BUS_VOLTAGE = 0x02
CALIBRATION = 0x05
# V per count.
VOLTAGE_UNIT = 0.004
# Bits of the configuration that read as 0, and those of the mode: 0 and 4 do not measure.
CONFIGURATION_ZEROS = 0xC000
MODE_BITS = 0x0007
MODES_AT_REST = (0, 4)
# V of a lithium cell that a car can have: below it is damaged, above it does not exist.
CELL_RANGE = (2.0, 4.5)


def decode_voltage(register: int) -> float | None:
    """Return the bus voltage [V] of its register; None if a bit is set that reads as 0."""
    return None if register & 0x0004 else (register >> 3) * VOLTAGE_UNIT


def read_register(bus: Bus, address: int, register: int) -> int:
    """Read 16 bits. Raises BusError or OSError."""
    answer = bytearray(2)
    bus.writeto_then_readfrom(address, bytes((register,)), answer)
    return answer[0] << 8 | answer[1]


def is_plausible(voltage: float | None, cells: int) -> bool:
    """Return whether a battery of ``cells`` in series can have a voltage [V]."""
    low, high = CELL_RANGE
    return voltage is not None and low * cells <= voltage <= high * cells


def check_ina219(bus: Bus, address: int, cells: int) -> None:
    """Check that the device at ``address`` answers as an INA219 on a battery of ``cells``.

    Raises BusError with what was found; OSError of the bus.
    """
    configuration = read_register(bus, address, CONFIGURATION)
    register = read_register(bus, address, BUS_VOLTAGE)
    calibration = read_register(bus, address, CALIBRATION)
    measures = configuration & MODE_BITS not in MODES_AT_REST
    ours = measures and not configuration & CONFIGURATION_ZEROS and not calibration & 1
    if not ours or not is_plausible(decode_voltage(register), cells):
        low, high = CELL_RANGE
        raise BusError(
            f"the device at {address:#04x} is no INA219 on a battery of {cells} cells",
            found=f"registers 0, 2, 5: {configuration:#06x}, {register:#06x}, {calibration:#06x}",
            expected=f"an INA219 that measures {low * cells:g} to {high * cells:g} V",
            likely="another chip, other cells, or the battery is not connected",
            remedy="check address and cells of [battery] in car.toml")
