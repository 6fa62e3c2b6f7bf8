"""``dart-hal find``: which serial ports and I2C buses are there, and behind which is a car."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import click

from dart_hal.car.handshake import identify_port
from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import print_json, say
from dart_hal.core.errors import DartHalError
from dart_hal.devices.links.attached import LIDAR, PortSeen, serial_ports
from dart_hal.devices.links.computers import BRIDGES, BusSeen, Computer, computer, i2c_buses

UNPLUG = ("which one is the car: unplug it and run dart-hal find again; the line that is gone is "
          "its port")
PROBE = "dart-hal find --probe asks each USB port for its firmware; that restarts the board on it"
PLUG = ("no USB serial port is there: plug the Nano in with a cable that carries data, wait 2 s, "
        "run dart-hal find again")


@click.command("find")
@click.option("--probe", is_flag=True, help="open each USB port that no program uses and ask for "
              "the firmware; opening a port restarts the board on it")
@json_option
def command(probe: bool, as_json: bool) -> int:
    """List serial ports and I2C buses; with --probe, say which answers as a car.

    Without --probe nothing is opened. Exit 1 when --probe found no DART firmware.
    """
    ports, buses, here = serial_ports(), i2c_buses(), computer()
    number = _bus(buses, here)
    asked = [_asked(port) if probe else None for port in ports]
    answers = [a for a in asked if a is not None and a["hello"] is not None]
    lines = _hints(ports, probe)
    if as_json:
        print_json({"ports": [{**asdict(p), "url": _url(p, number), "probe": a}
                              for p, a in zip(ports, asked, strict=True)],
                    "i2c": [asdict(bus) for bus in buses],
                    "computer": here.name if here else None, "bus": number, "hints": lines})
    else:
        for port, answer in zip(ports, asked, strict=True):
            _show(port, answer, _url(port, number))
        for bus in buses:
            say(f"i2c={bus.number}  {bus.name}{_role(bus, number, here)}"
                f"{'' if bus.allowed else '  (not for this user)'}")
        if not buses:
            say("no I2C bus is offered to programs (/dev/i2c-*)")
        for line in lines:
            say(line)
    return 1 if probe and not answers else 0


def _asked(port: PortSeen) -> dict[str, Any] | None:
    """HELLO of the board on a USB port, or why there is none; None: it was not asked."""
    if not port.usb:
        return None
    if port.users:  # root could open it all the same, and restart the Nano of a car that drives
        return {"hello": None, "why": f"in use by {', '.join(port.users)}; not asked"}
    try:
        return {"hello": identify_port(port.device).as_json(), "why": ""}
    except DartHalError as error:
        found = f" ({error.found})" if error.found else ""
        return {"hello": None, "why": f"{error.what}{found}"}


def _bus(buses: Sequence[BusSeen], here: Computer | None) -> int | None:
    """The bus of the header, a USB-I2C bridge, or the only one; None: there is a choice."""
    if here is not None:
        return here.bus if here.bus in {bus.number for bus in buses} else None
    bridges = [bus for bus in buses if bus.name.startswith(BRIDGES)]
    some = bridges or buses
    return some[0].number if len(some) == 1 else None


def _role(bus: BusSeen, number: int | None, here: Computer | None) -> str:
    if bus.number != number:
        return ""
    return f"  <- header pins 3 and 5 of this {here.name}" if here else "  <- the car's"


def _url(port: PortSeen, number: int | None) -> str:
    """To open the car by; which bus is left out where there is a choice."""
    return f"serial://{port.device}" + (f"?i2c={number}" if number is not None else "")


def _hints(ports: Sequence[PortSeen], probe: bool) -> list[str]:
    if not any(port.usb for port in ports):
        return [PLUG]
    lidars = [f"a lidar may be on {port.device}: export DART_HAL_LIDAR=serial://"
              f"{port.link or port.device}, then dart-hal doctor"
              for port in ports if port.usb == LIDAR]
    return [*lidars, UNPLUG] if probe else [*lidars, UNPLUG, PROBE]


def _show(port: PortSeen, answer: dict[str, Any] | None, url: str) -> None:
    known = ", ".join(filter(None, (port.usb or "no USB device", port.bridge or port.description)))
    say(f"{port.device}  {known}")
    if port.link:
        say(f"    {port.link}")
    if answer is None:
        if port.users:
            say(f"    in use by {', '.join(port.users)}")
    elif answer["hello"] is None:
        say(f"    {answer['why']}")
    else:
        hello = answer["hello"]
        say(f"    DART firmware {hello['firmware']}, board {hello['board_id']}; "
             f"dart-hal doctor --url '{url}'")
