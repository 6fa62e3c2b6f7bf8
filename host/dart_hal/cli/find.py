"""``dart-hal find``: list serial ports and I2C buses, and identify the port of the car."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import click

from dart_hal.car.handshake import identify_port
from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import print_json, print_line
from dart_hal.core.errors import DartHalError
from dart_hal.devices.links.attached import LIDAR, SerialPortInfo, serial_ports
from dart_hal.devices.links.computers import BRIDGES, Computer, I2cBusInfo, computer, i2c_buses

UNPLUG_HINT = ("to identify the port of the car: unplug the car and run dart-hal find again; the "
               "line "
               "that is missing is its port")
PROBE_HINT = ("dart-hal find --probe requests the firmware version on each USB port; that "
              "restarts the "
              "board on it")
PLUG_HINT = ("no USB serial port: plug the Nano in with a cable that carries data, wait 2 s, run "
             "dart-hal find again")


@click.command("find")
@click.option("--probe", is_flag=True, help="open each USB port that no program uses and request "
              "the firmware version; opening a port restarts the board on it")
@json_option
def command(probe: bool, as_json: bool) -> int:
    """List serial ports and I2C buses; with --probe, show which of them is a car.

    Without --probe no port is opened. Exit 1 if --probe found no DART firmware.
    """
    ports = serial_ports()
    buses = i2c_buses()
    here = computer()
    number = _choose_bus(buses, here)
    probes = [_probe_port(port) if probe else None for port in ports]
    answers = [a for a in probes if a is not None and a["hello"] is not None]
    lines = _hints(ports, probe)
    if as_json:
        print_json({"ports": [{**asdict(p), "url": _car_url(p, number), "probe": a}
                              for p, a in zip(ports, probes, strict=True)],
                    "i2c": [asdict(bus) for bus in buses],
                    "computer": here.name if here else None, "bus": number, "hints": lines})
    else:
        for port, answer in zip(ports, probes, strict=True):
            _print_port(port, answer, _car_url(port, number))
        for bus in buses:
            print_line(f"i2c={bus.number}  {bus.name}{_describe_role(bus, number, here)}"
                       f"{'' if bus.allowed else '  (no permission for this user)'}")
        if not buses:
            print_line("no I2C bus is available to programs (/dev/i2c-*)")
        for line in lines:
            print_line(line)
    return 1 if probe and not answers else 0


def _probe_port(port: SerialPortInfo) -> dict[str, Any] | None:
    """Return HELLO of the board on a USB port, or why it has none; None for other ports."""
    if not port.usb:
        return None
    # Root could open a port in use, which would restart the Nano of a car that drives.
    if port.users:
        return {"hello": None, "why": f"in use by {', '.join(port.users)}; not probed"}
    try:
        return {"hello": identify_port(port.device).as_json(), "why": ""}
    except DartHalError as error:
        found = f" ({error.found})" if error.found else ""
        return {"hello": None, "why": f"{error.what}{found}"}


def _choose_bus(buses: Sequence[I2cBusInfo], here: Computer | None) -> int | None:
    """Return the bus at the header, of a USB-I2C bridge, or the only one; None if ambiguous."""
    # 1. A known computer has its bus at the header. 2. Else the only bridge. 3. Else the only bus.
    #    No guess among several: commands would go to another device.
    if here is not None:
        return here.bus if here.bus in {bus.number for bus in buses} else None
    bridges = [bus for bus in buses if bus.name.startswith(BRIDGES)]
    candidates = bridges or buses
    return candidates[0].number if len(candidates) == 1 else None


def _describe_role(bus: I2cBusInfo, number: int | None, here: Computer | None) -> str:
    if bus.number != number:
        return ""
    return f"  <- header pins 3 and 5 of this {here.name}" if here else "  <- the car's"


def _car_url(port: SerialPortInfo, number: int | None) -> str:
    """Return the URL of the car; without the bus if that is ambiguous."""
    return f"serial://{port.device}" + (f"?i2c={number}" if number is not None else "")


def _hints(ports: Sequence[SerialPortInfo], probe: bool) -> list[str]:
    if not any(port.usb for port in ports):
        return [PLUG_HINT]
    lidars = [f"a lidar may be on {port.device}: export DART_HAL_LIDAR=serial://"
              f"{port.link or port.device}, then dart-hal doctor"
              for port in ports if port.usb == LIDAR]
    return [*lidars, UNPLUG_HINT] if probe else [*lidars, UNPLUG_HINT, PROBE_HINT]


def _print_port(port: SerialPortInfo, answer: dict[str, Any] | None, url: str) -> None:
    known = ", ".join(filter(None, (port.usb or "no USB device", port.bridge or port.description)))
    print_line(f"{port.device}  {known}")
    if port.link:
        print_line(f"    {port.link}")
    if answer is None:
        if port.users:
            print_line(f"    in use by {', '.join(port.users)}")
    elif answer["hello"] is None:
        print_line(f"    {answer['why']}")
    else:
        hello = answer["hello"]
        print_line(f"    DART firmware {hello['firmware']}, board {hello['board_id']}; "
                    f"dart-hal doctor --url '{url}'")
