"""The serial ports of this computer, found without opening any."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

from dart_hal.devices.links.serial_port import holders

# USB bridge on the adapter of an X4.
LIDAR = "10C4:EA60"
# USB bridges of such boards, by the numbers of vendor and product.
BRIDGES = {"1A86:7523": "CH340, as on most Nano clones", "0403:6001": "FT232, as on an older Nano",
           "2341:0043": "ATmega16U2 of an Uno",
           LIDAR: "CP2102, as on the adapters of YDLidar, RPLidar and LD19"}


@dataclass(frozen=True, slots=True)
class SerialPortInfo:
    """A serial port.

    usb: "VID:PID", "" if it is not a USB device; bridge: description of the USB bridge; link: path
    that does not change when other devices are plugged in; users: programs that have it open.
    """

    device: str
    usb: str
    bridge: str
    description: str
    serial_number: str
    link: str
    users: tuple[str, ...]


def serial_ports(links: Path = Path("/dev/serial/by-id")) -> list[SerialPortInfo]:
    """Return all serial ports, those of USB first, each group sorted by name."""
    stable = {os.path.realpath(p): str(p) for p in links.iterdir()} if links.is_dir() else {}
    ports = []
    for port in list_ports.comports():
        usb = f"{port.vid:04X}:{port.pid:04X}" if port.vid is not None else ""
        about = port.description if port.description not in (None, "n/a") else ""
        users = tuple(f"{name} ({pid})" for pid, name in holders(port.device)
                      if pid != os.getpid())
        ports.append(SerialPortInfo(port.device, usb, BRIDGES.get(usb, ""), about,
                                    port.serial_number or "",
                                    stable.get(os.path.realpath(port.device), ""), users))
    return sorted(ports, key=lambda p: (not p.usb, p.device))
