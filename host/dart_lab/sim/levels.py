"""Levels of logic inputs that are not driven.

Figures: data sheets of NXP PCA9685 (input /OE) and 74HCT157, limits at 5 V unless stated
otherwise.
"""

from __future__ import annotations

# Highest low and lowest high level of /OE and of every HCT input [V]; undefined between them.
V_IL = 0.8
V_IH = 2.0

# Supply of the PCA9685 from the computer [V].
LOGIC_V = 3.3


def divider_voltage(supply: float, up: float, down: float | None) -> float:
    """Return the voltage [V] between a pull-up and a pull-down [ohm]; None = no pull-down."""
    return supply if down is None else supply * down / (up + down)


def logic_level(volt: float) -> bool | None:
    """Return the logic level of an input at a voltage [V]; None = undefined."""
    return True if volt >= V_IH else False if volt <= V_IL else None
