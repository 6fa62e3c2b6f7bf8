"""Bootloaders of a Nano: what lies between a reset and the program.

Meanwhile every pin is an input and the line is silent, so the cut-off sees
released pins. Figures: data sheet of the ATmega328P, sources of both
bootloaders, `docs/explanation/emulator.md`.
"""

from __future__ import annotations

from typing import NamedTuple


class BootWait(NamedTuple):
    """Seconds of start-up after any reset, then of bootloader after an external reset
    (DTR, button) and after any other; ``clears``: the program finds MCUSR = 0."""

    startup: float = 0.0
    external: float = 0.0
    other: float = 0.0
    clears: bool = False


STARTUP = 0.065
"""s that the fuses of a Nano (SUT = 11) hold the MCU in reset, typical at 5 V."""

BOOTS = {
    "none": BootWait(),
    "old": BootWait(STARTUP, 1.325, 1.325),
    "optiboot": BootWait(STARTUP, 1.0, 0.0, clears=True),
}
"""``old``: ATmegaBOOT waits after every reset (measured on its own image) and leaves MCUSR
alone. Optiboot 4.4 waits for its watchdog of 1 s, but only when MCUSR says EXTRF, and
clears MCUSR. ``none``: the program alone, started at once."""
