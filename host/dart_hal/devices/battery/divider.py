"""Voltage of a battery behind a resistor divider at A0 of the Nano.

The Nano converts A0 and its band gap of 1.1 V against the same supply, which cancels:

    V = ratio x 1.1 V x pin / reference

The band gap differs by up to 10 % between parts (data sheet of the ATmega328P, table 28-3) and is
constant for one: multiply ``ratio`` by voltmeter / reading once. Then the error is below 2 %: two
counts of 225 of the reference, two counts of A0, and the drift of the band gap.
"""

from __future__ import annotations

from collections.abc import Mapping

from dart_hal.core.errors import BatteryUnmeasured
from dart_hal.devices.battery.ina219 import CELL_RANGE, is_plausible

BAND_GAP_V = 1.1
# Sum of four conversions at the supply, above which A0 is at the supply; a divider cannot be.
MAX_PIN_COUNTS = 4 * 1015
# Counts of A0 with its pull-up of 20 to 50 kohm: a divider of up to 10 kohm holds it lower,
# with 4.4 V of 5 V and 20 kohm at (4.4 x 20 + 5 x 10) / 30 = 4.6 V, 941 counts.
MAX_PULLED_COUNTS = 1000


def decode_divider(values: Mapping[str, int], ratio: float, cells: int
                   ) -> float | BatteryUnmeasured:
    """Return the voltage [V] of the values of a message BATTERY, or why there is none."""
    pin = values["pin"]
    pulled = values["pulled"]
    reference = values["reference"]
    if pulled > MAX_PULLED_COUNTS or pin > MAX_PIN_COUNTS or not reference:
        return BatteryUnmeasured("no divider holds A0 of the Nano",
                                 found=f"{pulled} of 1023 counts with the pull-up of the pin",
                                 expected=f"at most {MAX_PULLED_COUNTS}")
    voltage = ratio * BAND_GAP_V * pin / reference
    if is_plausible(voltage, cells):
        return voltage
    low, high = CELL_RANGE
    return BatteryUnmeasured(f"{voltage:.2f} V is no voltage of a battery of {cells} cells",
                             expected=f"{low * cells:g} to {high * cells:g} V",
                             remedy="check ratio and cells of [battery] in car.toml")
