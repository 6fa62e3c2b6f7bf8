"""``dart-hal fleet``: the cars of a room; watch them; stop them all."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dart_hal.car.viewers import open_viewer
from dart_hal.cli.common.options import Number, json_option, room_key_option
from dart_hal.cli.common.output import console, notices, print_json, say
from dart_hal.cli.common.page_address import lan_option, tell
from dart_hal.control.keyboard import Terminal
from dart_hal.core.errors import UsageError
from dart_hal.fleet.discovery import found, listed
from dart_hal.fleet.key import find_key
from dart_hal.fleet.station import Seen, Station
from dart_hal.fleet.stopping import REPEAT

ASKED = 1.5
"""s for mDNS to answer."""
HEARD = 1.0
"""s in which a car is heard twenty times."""
FIND_CARS = 0.5
"""s for which a stop is repeated at least: ten messages of each car, so that all are known."""
WITHOUT_KEY = ("this room is entered without a key: each computer on its network can stop its "
               "cars, keep a watched car driving and send wrong poses (--room-key FILE)")

room_option = click.option(
    "--room", "rooms", multiple=True, metavar="URL",
    help="udp://239.255.42.99:7447, udp://:7448?to=10.0.0.11:7447, zenoh://lab; several times for "
         "several (default: $DART_HAL_ROOM, then those that announce themselves by mDNS)")


@click.group("fleet", invoke_without_command=True)
@room_option
@room_key_option
@json_option
@click.pass_context
def command(context: click.Context, rooms: tuple[str, ...], room_key: Path | None,
            as_json: bool) -> int:
    """List the cars of a room: state, link, health. Below: watch, stop, page. Exit 1: no car.

    Without a key (--room-key) each computer on the network of the room can stop the cars, keep a
    watched car driving and send wrong poses. None can arm or drive a car through the room.
    """
    if context.invoked_subcommand is not None:
        if rooms or room_key is not None:
            raise UsageError("--room and --room-key stand behind the verb",
                             found=" ".join((*rooms, *([str(room_key)] if room_key else []))),
                             expected=f"dart-hal fleet {context.invoked_subcommand} --room URL")
        return 0
    with ExitStack() as stack:
        stations = _entered(rooms, room_key, stack)
        for station in stations:
            station.listen(HEARD)
        cars = [(station, seen) for station in stations for seen in station.cars()]
        if as_json:
            print_json({"cars": [_json(*one) for one in cars], **_ignored(stations)})
        for station, seen in cars if not as_json else ():
            say(f"{seen.name:16} {seen.state:9} {_why(station, seen)}  {station.transport.url}")
        if not cars and not as_json:
            say(f"no car was heard in {', '.join(s.transport.url for s in stations)}"
                + ("" if stations[0].has_key else "; cars with a room key answer only to the key"))
        notices(_ignored_lines(stations))
    return 0 if cars else 1


@command.command("stop")
@room_option
@room_key_option
@click.option("--why", default="", help="for the one who reads the log")
@json_option
def stop_command(rooms: tuple[str, ...], room_key: Path | None, why: str, as_json: bool) -> int:
    """Stop every car of a room: throttle neutral, disarmed. Exit 1 if a known one does not answer.

    Repeated until each car that was heard has answered, for 2 s at most. Of two programs with one
    name both have to answer.
    """
    with ExitStack() as stack:
        stations = _entered(rooms, room_key, stack)
        calls = [station.call_stop(why, FIND_CARS) for station in stations]
        while sum(not station.press() for station in stations):  # each is pressed, not the first
            time.sleep(REPEAT / 2)
        ignored = _ignored(stations)
        notices(_ignored_lines(stations))
    silent = sorted(set().union(*(call.silent for call in calls)))
    answered = sorted(set().union(*(call.answered for call in calls)) - set(silent))
    if as_json:
        print_json({"stopped": answered, "silent": silent, **ignored})
    else:
        say(f"stopped: {', '.join(answered) or 'no car answered'}")
        if silent:
            say(f"no answer: {', '.join(silent)}")
    return 0 if answered and not silent else 1


@command.command("watch")
@room_option
@room_key_option
@click.option("--duration", type=Number(min=0.1), default=None,
              help="seconds (default: until q or Ctrl-C)")
@json_option
def watch_command(rooms: tuple[str, ...], room_key: Path | None, duration: float | None,
                  as_json: bool) -> None:
    """Watch the cars of a room, live. Any key stops all of them; q leaves.

    While it runs, cars that ``join(car, room, beat_within=0.5)`` may drive; when it ends, dies or
    loses the network they stop.
    """
    end = time.monotonic() + (duration or float("inf"))
    with ExitStack() as stack:
        stations = _entered(rooms, room_key, stack)
        keys = _keys(stack)
        live = None if as_json else stack.enter_context(Live(console=console, auto_refresh=False))
        shown = 0.0
        while time.monotonic() < end:
            pressed = keys.keys() if keys is not None else b""
            if pressed in (b"q", b"\x03"):
                break
            for station in stations:
                station.watch()
                if pressed:
                    station.call_stop("a key of dart-hal fleet watch")
                station.press()
            if live is not None and time.monotonic() - shown > 0.1:
                shown = time.monotonic()
                live.update(_picture(stations), refresh=True)
            time.sleep(REPEAT)
        if as_json:
            print_json({"cars": [_json(s, seen) for s in stations for seen in s.cars()],
                        **_ignored(stations)})


@command.command("page")
@room_option
@room_key_option
@lan_option
@click.option("--duration", type=Number(min=0.1), default=None, help="s (default: until Ctrl-C)")
@json_option
def page_command(rooms: tuple[str, ...], room_key: Path | None, lan: bool, port: int,
                 duration: float | None, as_json: bool) -> None:
    """One page in the browser with all cars of a room, and a STOP for all of them.

    It watches as ``fleet watch`` does, while the programs of the cars run. Each browser that
    reaches the page may stop the cars, also those of a room with a key.
    """
    end = time.monotonic() + (duration or float("inf"))
    with ExitStack() as stack:
        stations = _entered(rooms, room_key, stack)
        page = stack.enter_context(open_viewer("fleet", stations, port=port, lan=lan))
        tell(page.urls, lan, as_json)
        while time.monotonic() < end:
            time.sleep(0.1)


def _entered(rooms: tuple[str, ...], room_key: Path | None, stack: ExitStack) -> list[Station]:
    """A station in each room. Raises UsageError where none is named or announces itself."""
    key = find_key(room_key)
    urls = listed(rooms)
    if not urls:
        urls = tuple(dict.fromkeys(found(ASKED).values()))
        if not urls:
            raise UsageError("no room of cars is named, and none announces itself", found="none",
                             expected="--room udp://239.255.42.99:7447, or $DART_HAL_ROOM",
                             remedy="dart-hal fleet --room udp://239.255.42.99:7447")
    if key is None:
        notices((WITHOUT_KEY,))
    return [stack.enter_context(Station(url, room_key=key)) for url in urls]


def _ignored(stations: list[Station]) -> dict[str, dict[str, str]]:
    """For JSON: the members that are ignored and why, if there are any."""
    found: dict[str, str] = {}
    for station in stations:
        found |= station.ignored()
    return {"ignored": found} if found else {}


def _ignored_lines(stations: list[Station]) -> tuple[str, ...]:
    return tuple(f"{name} in {station.transport.url} is ignored: {why}"
                 for station in stations for name, why in sorted(station.ignored().items()))


def _keys(stack: ExitStack) -> Terminal | None:
    try:
        keys = Terminal()
    except UsageError:
        notices(("standard input is no terminal: no key stops the cars here",))
        return None
    stack.callback(keys.close)
    return keys


def _why(station: Station, seen: Seen) -> str:
    """What there is to know of a car beyond its state, on one line."""
    parts = [f"heard {1e3 * seen.silent:.0f} ms ago, {seen.lost} lost"]
    if seen.health is not None:
        parts += [text for text in (seen.health.held, " ".join(sorted(seen.health.doubts))) if text]
    if seen.name in station.peers.namesakes:
        parts.append("two programs have this name")
    return "; ".join(parts)


def _json(station: Station, seen: Seen) -> dict[str, Any]:
    pose = seen.pose
    return {"name": seen.name, "url": station.transport.url, "state": seen.state,
            "why": _why(station, seen), "silent_s": seen.silent, "lost": seen.lost,
            "doubts": sorted(seen.health.doubts) if seen.health else [],
            "pose": None if pose is None else {
                "x": pose.pose.x, "y": pose.pose.y, "yaw": pose.pose.yaw, "frame": pose.frame,
                "speed": pose.speed, "age_s": pose.age}}


def _picture(stations: list[Station]) -> Table:
    table = Table("car", "state", "x, y [m]", "speed [m/s]", "age [ms]", "what else", box=None,
                  title="any key stops all cars; q leaves")
    for station in stations:
        for seen in station.cars():
            pose = seen.pose
            told = ("-",) * 3 if pose is None else (
                f"{pose.pose.x:+.2f} {pose.pose.y:+.2f}", f"{pose.speed:+.2f}",
                f"{1e3 * pose.age:.0f}")
            cells = (seen.name, seen.state, *told, _why(station, seen))
            table.add_row(*map(Text, cells))  # names come from the network: no markup
        for line in _ignored_lines([station]):
            table.add_row("", "ignored", "", "", "", Text(line))
    return table
