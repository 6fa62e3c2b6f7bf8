"""Bootloaders of a Nano: the time between a reset and the start of the program.

During this time every pin is an input and the line is silent, so the cut-off gets released pins.
Figures: data sheet of the ATmega328P, sources of both bootloaders, `docs/explanation/emulator.md`.
"""

from __future__ import annotations

from typing import NamedTuple


class BootWait(NamedTuple):
    """Times [s] of start-up after any reset, then of the bootloader after an external reset
    (DTR, button) and after any other one; ``clears``: the program reads MCUSR = 0."""

    startup: float = 0.0
    external: float = 0.0
    other: float = 0.0
    clears: bool = False


# s of reset by the fuses of a Nano (SUT = 11), typical at 5 V.
STARTUP = 0.065

# ``old``: ATmegaBOOT waits after every reset (measured on its own image) and does not change MCUSR.
# Optiboot 4.4 waits for its watchdog of 1 s, but only if MCUSR contains EXTRF, and clears MCUSR.
# ``none``: the program alone, started at once.
BOOTS = {
    "none": BootWait(),
    "old": BootWait(STARTUP, 1.325, 1.325),
    "optiboot": BootWait(STARTUP, 1.0, 0.0, clears=True),
}
