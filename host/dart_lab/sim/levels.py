"""Levels of logic inputs that are not driven, and currents into a chip without supply.

Figures: data sheets of NXP PCA9685 (input /OE), 74HCT157 and ATmega328P, limits at 5 V unless
stated otherwise.
"""

from __future__ import annotations

# Highest low and lowest high level of /OE and of every HCT input [V]; undefined between them.
V_IL = 0.8
V_IH = 2.0

# Supply of the PCA9685 from the computer [V].
LOGIC_V = 3.3

# Voltage across a conducting clamp diode [V].
DIODE_V = 0.6

# Output resistance of the ATmega328P [ohm]: 0.5 V at 20 mA.
PIN_OHM = 25.0

# Absolute maximum of the current into an input clamp of 74HC and 74HCT parts [A].
CLAMP_MAX = 0.020


def divider_voltage(supply: float, up: float, down: float | None) -> float:
    """Return the voltage [V] between a pull-up and a pull-down [ohm]; None = no pull-down."""
    return supply if down is None else supply * down / (up + down)


def logic_level(volt: float) -> bool | None:
    """Return the logic level of an input at a voltage [V]; None = undefined."""
    return True if volt >= V_IH else False if volt <= V_IL else None


def clamp_current(volt: float, series: float) -> float:
    """Return the current [A] from a pin at ``volt`` over ``series`` ohm into a chip at 0 V."""
    return max(0.0, volt - DIODE_V) / (series + PIN_OHM)
