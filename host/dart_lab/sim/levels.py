"""Levels of logic inputs that nothing drives, and what flows into a chip without supply.

Figures: NXP PCA9685 (inputs /OE), 74HCT157, ATmega328P, each data sheet's limits at 5 V
unless said otherwise.
"""

from __future__ import annotations

V_IL, V_IH = 0.8, 2.0
"""V; what /OE and every HCT input take for low and high. Between them: anything."""

LOGIC_V = 3.3
"""V; supply of the PCA9685 from the computer."""

DIODE_V = 0.6
"""V across a clamp diode that conducts."""

PIN_OHM = 25.0
"""ohm; output of the ATmega328P (0.5 V at 20 mA)."""

CLAMP_MAX = 0.020
"""A; absolute maximum of the input clamps of 74HC and 74HCT parts."""


def divided(supply: float, up: float, down: float | None) -> float:
    """V between a pull-up and a pull-down [ohm]; None = no pull-down."""
    return supply if down is None else supply * down / (up + down)


def level(volt: float) -> bool | None:
    """What an input takes that voltage for; None = undefined."""
    return True if volt >= V_IH else False if volt <= V_IL else None


def clamp_current(volt: float, series: float) -> float:
    """A from a pin at ``volt`` through ``series`` ohm into a chip whose supply is at 0 V."""
    return max(0.0, volt - DIODE_V) / (series + PIN_OHM)
