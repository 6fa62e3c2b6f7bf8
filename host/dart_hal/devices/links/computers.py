"""I2C buses of this computer, and which is at pins 3 and 5: by the name of its board.

The number differs: an Orin Nano has a bus 1 as well, and the part that answers
at 0x40 there is its power monitor. ``host/setup/checks.sh`` has the same table
for a computer on which nothing is installed yet; a test compares the two.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from dart_hal.core.errors import BusMissing
from dart_hal.core.url import Url

I2C = Path("/sys/class/i2c-dev")
MODEL = Path("proc") / "device-tree" / "model"
AUTO = "auto"
"""The value of ``i2c=`` for which the bus is found here."""
BRIDGES = ("MCP2221", "CP2112", "i2c-tiny-usb")
"""Beginnings of the adapters' names of USB-I2C bridges, as the drivers of Linux give them."""


@dataclass(frozen=True, slots=True)
class Computer:
    """``words``: a part of the model in the device tree; ``bus``: of header pins 3 and 5."""

    name: str
    words: str
    bus: int


COMPUTERS = (
    Computer("Jetson Orin Nano", "Orin Nano", 7),
    Computer("Jetson Nano", "Jetson Nano", 1),
    Computer("Raspberry Pi", "Raspberry Pi", 1),
)
"""Numbers: NVIDIA's and Raspberry Pi's documents of the 40-pin headers."""


@dataclass(frozen=True, slots=True)
class BusSeen:
    """An I2C bus: its number, the name of its adapter, and whether this user may use it."""

    number: int
    name: str
    allowed: bool


def i2c_buses(adapters: Path = I2C) -> list[BusSeen]:
    """Buses that the kernel offers to programs, by number."""
    seen = []
    for entry in adapters.glob("i2c-*"):
        number = entry.name.removeprefix("i2c-")
        if number.isdecimal():
            name = entry / "name"
            seen.append(BusSeen(int(number), name.read_text().strip() if name.is_file() else "",
                                os.access(f"/dev/{entry.name}", os.R_OK | os.W_OK)))
    return sorted(seen, key=lambda bus: bus.number)


def model(root: Path = Path("/")) -> str:
    """What the board calls itself in its device tree; "" for a PC."""
    try:
        return (root / MODEL).read_bytes().rstrip(b"\0\n").decode("utf-8", "replace")
    except OSError:
        return ""


def computer(root: Path = Path("/")) -> Computer | None:
    """The computer that this is, None for one that is not known."""
    name = model(root)
    return next((known for known in COMPUTERS if known.words in name), None)


def find_bus(root: Path = Path("/")) -> int:
    """Number of the bus of the car: that of the header, on a PC that of the only USB-I2C bridge.

    Raises BusMissing with the buses that are there.
    """
    buses = i2c_buses(root / "sys" / "class" / "i2c-dev")
    here = computer(root)
    if here is not None:
        found = [bus for bus in buses if bus.number == here.bus]
        wanted = f"bus {here.bus}, header pins 3 and 5 of a {here.name}"
    else:
        found = [bus for bus in buses if bus.name.startswith(BRIDGES)]
        wanted = f"one USB-I2C bridge ({', '.join(BRIDGES)})"
    if len(found) == 1:
        return found[0].number
    there = ", ".join(f"i2c-{bus.number} {bus.name}" for bus in found or buses) or "none"
    raise BusMissing(f"i2c={AUTO} finds no bus on {model(root) or 'this computer'}",
                     found=f"{len(found)} such; buses: {there}", expected=wanted)


def settled(url: Url, root: Path = Path("/")) -> Url:
    """The URL with the number of the bus in place of ``i2c=auto``. Raises BusMissing."""
    if url.options.get("i2c") != AUTO:
        return url
    return replace(url, options={**url.options, "i2c": str(find_bus(root))})
