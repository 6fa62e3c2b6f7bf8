"""I2C buses of this computer, and the one at header pins 3 and 5, by the name of the board.

The number differs between boards: an Orin Nano also has a bus 1, and the device at 0x40 there is
its power monitor. ``host/setup/checks.sh`` has the same table for a computer on which nothing is
installed yet; a test compares the two.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from dart_hal.core.errors import BusMissing
from dart_hal.core.url import Url

I2C = Path("/sys/class/i2c-dev")
MODEL = Path("proc") / "device-tree" / "model"
# Value of ``i2c=`` for which ``find_bus`` finds the bus.
AUTO = "auto"
# Prefixes of the adapter names of USB-I2C bridges, from the drivers of Linux.
BRIDGES = ("MCP2221", "CP2112", "i2c-tiny-usb")


@dataclass(frozen=True, slots=True)
class Computer:
    """A board: ``words``: part of its model in the device tree; ``bus``: of header pins 3 and 5."""

    name: str
    words: str
    bus: int


# Bus numbers: documents of NVIDIA and Raspberry Pi about the 40-pin headers.
COMPUTERS = (
    Computer("Jetson Orin Nano", "Orin Nano", 7),
    # From memory until "Jetson Nano"; a wrong bus is refused, because no PCA9685 answers there.
    Computer("Jetson Orin NX", "Orin NX", 7),
    Computer("Jetson AGX Orin", "AGX Orin", 7),
    Computer("Jetson Xavier NX", "Xavier NX", 8),
    Computer("Jetson AGX Xavier", "AGX Xavier", 8),
    # The same kit with the device tree of JetPack 4.
    Computer("Jetson AGX Xavier", "Jetson-AGX", 8),
    Computer("Jetson Nano", "Jetson Nano", 1),
    Computer("Raspberry Pi", "Raspberry Pi", 1),
)


@dataclass(frozen=True, slots=True)
class I2cBusInfo:
    """An I2C bus: its number, the name of its adapter, and whether this user may use it."""

    number: int
    name: str
    allowed: bool


def i2c_buses(adapters: Path = I2C) -> list[I2cBusInfo]:
    """Return the buses that the kernel offers to programs, by number."""
    buses = []
    for entry in adapters.glob("i2c-*"):
        number = entry.name.removeprefix("i2c-")
        if number.isdecimal():
            name = entry / "name"
            buses.append(I2cBusInfo(int(number),
                                    name.read_text().strip() if name.is_file() else "",
                                    os.access(f"/dev/{entry.name}", os.R_OK | os.W_OK)))
    return sorted(buses, key=lambda bus: bus.number)


def model(root: Path = Path("/")) -> str:
    """Return the model of the board from its device tree; "" for a PC."""
    try:
        return (root / MODEL).read_bytes().rstrip(b"\0\n").decode("utf-8", "replace")
    except OSError:
        return ""


def computer(root: Path = Path("/")) -> Computer | None:
    """Return the entry of this computer, None for an unknown one."""
    name = model(root)
    return next((known for known in COMPUTERS if known.words in name), None)


def find_bus(root: Path = Path("/")) -> int:
    """Return the number of the header's bus, or on a PC that of the only USB-I2C bridge.

    Raises BusMissing with the buses that exist.
    """
    buses = i2c_buses(root / "sys" / "class" / "i2c-dev")
    here = computer(root)
    if here is not None:
        found = [bus for bus in buses if bus.number == here.bus]
        expected = f"bus {here.bus}, header pins 3 and 5 of a {here.name}"
    else:
        found = [bus for bus in buses if bus.name.startswith(BRIDGES)]
        expected = f"one USB-I2C bridge ({', '.join(BRIDGES)})"
    if len(found) == 1:
        return found[0].number
    names = ", ".join(f"i2c-{bus.number} {bus.name}" for bus in found or buses) or "none"
    raise BusMissing(f"i2c={AUTO} finds no bus on {model(root) or 'this computer'}",
                     found=f"{len(found)} such; buses: {names}", expected=expected)


def resolve_bus(url: Url, root: Path = Path("/")) -> Url:
    """Replace ``i2c=auto`` in a URL by the number of the bus. Raises BusMissing."""
    if url.options.get("i2c") != AUTO:
        return url
    return replace(url, options={**url.options, "i2c": str(find_bus(root))})
