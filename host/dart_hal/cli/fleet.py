"""``dart-hal fleet``: list the cars of a fleet room, watch them, stop them all."""

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
from dart_hal.cli.common.options import FiniteNumber, json_option, room_key_option
from dart_hal.cli.common.output import console, print_json, print_line, show_notices
from dart_hal.cli.common.page_address import lan_option, print_page_address
from dart_hal.control.keyboard import Terminal
from dart_hal.core.errors import UsageError
from dart_hal.fleet.discovery import discover_rooms, list_rooms
from dart_hal.fleet.key import find_key
from dart_hal.fleet.station import CarStatus, Station
from dart_hal.fleet.stopping import STOP_INTERVAL

# Time for rooms to answer to mDNS.
MDNS_WAIT_S = 1.5
# Each car sends 20 messages a second.
LISTEN_TIME_S = 1.0
# Shortest time for which a stop is repeated: ten messages of each car, so that all are known.
MIN_STOP_TIME_S = 0.5
WITHOUT_KEY = ("this room has no key: each computer on its network can stop its "
               "cars, keep a watched car driving and send wrong poses (--room-key FILE)")

room_option = click.option(
    "--room", "rooms", multiple=True, metavar="URL",
    help="udp://239.255.42.99:7447, udp://:7448?to=10.0.0.11:7447, zenoh://lab; repeat for several "
         "(default: $DART_HAL_ROOM, then the rooms announced by mDNS)")


@click.group("fleet", invoke_without_command=True)
@room_option
@room_key_option
@json_option
@click.pass_context
def command(context: click.Context, rooms: tuple[str, ...], room_key: Path | None,
            as_json: bool) -> int:
    """List the cars of a fleet room: state, link, health. Exit 1: no car.

    Without a key (--room-key) each computer on the network can stop the cars, keep a watched car
    driving and send wrong poses. None can arm or drive a car.
    """
    if context.invoked_subcommand is not None:
        # click gives options before a subcommand to the group, where they would have no effect.
        if rooms or room_key is not None:
            raise UsageError("--room and --room-key must follow the verb",
                             found=" ".join((*rooms, *([str(room_key)] if room_key else []))),
                             expected=f"dart-hal fleet {context.invoked_subcommand} --room URL")
        return 0
    with ExitStack() as stack:
        stations = _enter_rooms(rooms, room_key, stack)
        for station in stations:
            station.listen(LISTEN_TIME_S)
        cars = [(station, car) for station in stations for car in station.cars()]
        if as_json:
            print_json({"cars": [_car_json(*one) for one in cars], **_list_ignored(stations)})
        for station, car in cars if not as_json else ():
            print_line(f"{car.name:16} {car.state:9} {_describe_car(station, car)}  "
                       f"{station.transport.url}")
        if not cars and not as_json:
            print_line(f"no car answered in {', '.join(s.transport.url for s in stations)}"
                       + ("" if stations[0].has_key else
                          "; cars with a room key answer only to that key"))
        show_notices(_format_ignored(stations))
    return 0 if cars else 1


@command.command("stop")
@room_option
@room_key_option
@click.option("--why", default="", help="reason, for the log of each car")
@click.option("--expect", type=click.IntRange(min=1), default=None, metavar="N",
              help="number of cars that must answer; exit 1 if fewer do")
@json_option
def stop_command(rooms: tuple[str, ...], room_key: Path | None, why: str, expect: int | None,
                 as_json: bool) -> int:
    """Stop every car of a room: throttle neutral, disarmed. Exit 1 if a known car does not answer.

    The stop is repeated until each known car has answered, for at most 2 s. Two programs with the
    same name must both answer. A car whose program had died before is not known: --expect counts.
    """
    with ExitStack() as stack:
        stations = _enter_rooms(rooms, room_key, stack)
        # 1. Send the stop in all rooms. 2. Repeat it until all known cars have answered.
        calls = [station.call_stop(why, MIN_STOP_TIME_S) for station in stations]
        # sum, not any: the stop must be sent in every room, also while the first has no answer.
        while sum(not station.press() for station in stations):
            time.sleep(STOP_INTERVAL / 2)
        ignored = _list_ignored(stations)
        show_notices(_format_ignored(stations))
    silent = sorted(set().union(*(call.silent for call in calls)))
    # A car of several rooms, or two programs with one name, count once; any silence wins.
    answered = sorted(set().union(*(call.confirmed_cars for call in calls)) - set(silent))
    # A car whose program had died before is not known to the stations: only its number misses it.
    missing = max((expect or 0) - len(answered), 0)
    if as_json:
        print_json({"stopped": answered, "silent": silent, "missing": missing, **ignored})
    else:
        print_line(f"stopped: {', '.join(answered)}" if answered
                   else "no car answered: nothing was stopped")
        if silent:
            print_line(f"no answer: {', '.join(silent)}")
        if missing:
            print_line(f"{missing} of {expect} cars did not answer")
    return 0 if answered and not missing and not silent else 1


@command.command("watch")
@room_option
@room_key_option
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="seconds (default: until q or Ctrl-C)")
@json_option
def watch_command(rooms: tuple[str, ...], room_key: Path | None, duration: float | None,
                  as_json: bool) -> None:
    """Watch the cars of a room live. Any key stops all of them; q quits.

    Cars that join with ``join(car, room, beat_within=0.5)`` drive only while this runs. They stop
    when it ends, is killed or loses the network.
    """
    end = time.monotonic() + (duration or float("inf"))
    with ExitStack() as stack:
        stations = _enter_rooms(rooms, room_key, stack)
        keys = _open_keyboard(stack)
        live = None if as_json else stack.enter_context(Live(console=console, auto_refresh=False))
        updated = 0.0
        while time.monotonic() < end:
            pressed = keys.keys() if keys is not None else b""
            if pressed in (b"q", b"\x03"):
                break
            for station in stations:
                station.watch()
                if pressed:
                    station.call_stop("a key of dart-hal fleet watch")
                station.press()
            if live is not None and time.monotonic() - updated > 0.1:
                updated = time.monotonic()
                live.update(_make_table(stations), refresh=True)
            time.sleep(STOP_INTERVAL)
        if as_json:
            print_json({"cars": [_car_json(s, car) for s in stations for car in s.cars()],
                        **_list_ignored(stations)})


@command.command("page")
@room_option
@room_key_option
@lan_option
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="seconds (default: until Ctrl-C)")
@json_option
def page_command(rooms: tuple[str, ...], room_key: Path | None, lan: bool, port: int,
                 duration: float | None, as_json: bool) -> None:
    """Serve a page with all cars of a room and a STOP button for all of them.

    It watches the cars as ``fleet watch`` does. Each browser that reaches the page can stop the
    cars, also those of a room with a key.
    """
    end = time.monotonic() + (duration or float("inf"))
    with ExitStack() as stack:
        stations = _enter_rooms(rooms, room_key, stack)
        page = stack.enter_context(open_viewer("fleet", stations, port=port, lan=lan))
        print_page_address(page.urls, lan, as_json)
        while time.monotonic() < end:
            time.sleep(0.1)


def _enter_rooms(rooms: tuple[str, ...], room_key: Path | None, stack: ExitStack) -> list[Station]:
    """Join each room as a station. Raises UsageError without a named or announced room."""
    key = find_key(room_key)
    urls = list_rooms(rooms)
    if not urls:
        # Several members announce the same room.
        urls = tuple(dict.fromkeys(discover_rooms(MDNS_WAIT_S).values()))
        if not urls:
            raise UsageError("no fleet room: none is named, none is announced by mDNS",
                             found="none",
                             expected="--room udp://239.255.42.99:7447, or $DART_HAL_ROOM",
                             remedy="dart-hal fleet --room udp://239.255.42.99:7447")
    if key is None:
        show_notices((WITHOUT_KEY,))
    return [stack.enter_context(Station(url, room_key=key)) for url in urls]


def _list_ignored(stations: list[Station]) -> dict[str, dict[str, str]]:
    """Return for JSON the members that are ignored and why; empty if there are none."""
    found: dict[str, str] = {}
    for station in stations:
        found |= station.list_ignored()
    return {"ignored": found} if found else {}


def _format_ignored(stations: list[Station]) -> tuple[str, ...]:
    return tuple(f"{name} in {station.transport.url} is ignored: {why}"
                 for station in stations for name, why in sorted(station.list_ignored().items()))


def _open_keyboard(stack: ExitStack) -> Terminal | None:
    try:
        keys = Terminal()
    except UsageError:
        show_notices(("standard input is no terminal: keys cannot stop the cars",))
        return None
    stack.callback(keys.close)
    return keys


def _describe_car(station: Station, car: CarStatus) -> str:
    """Return link, health and conflicts of a car on one line."""
    parts = [f"last message {1e3 * car.silent:.0f} ms ago, {car.lost} lost"]
    if car.health is not None:
        if car.health.battery is not None:
            parts.append(f"battery {car.health.battery:.1f} V")
        parts += [text for text in (car.health.held, " ".join(sorted(car.health.doubts))) if text]
    if car.name in station.peers.namesakes:
        parts.append("two programs have this name")
    return "; ".join(parts)


def _car_json(station: Station, car: CarStatus) -> dict[str, Any]:
    pose = car.pose
    return {"name": car.name, "url": station.transport.url, "state": car.state,
            "why": _describe_car(station, car), "silent_s": car.silent, "lost": car.lost,
            "doubts": sorted(car.health.doubts) if car.health else [],
            "battery": car.health.battery if car.health else None,
            "pose": None if pose is None else {
                "x": pose.pose.x, "y": pose.pose.y, "yaw": pose.pose.yaw, "frame": pose.frame,
                "speed": pose.speed, "age_s": pose.age}}


def _make_table(stations: list[Station]) -> Table:
    table = Table("car", "state", "x, y [m]", "speed [m/s]", "age [ms]", "notes", box=None,
                  title="any key stops all cars; q quits")
    for station in stations:
        for car in station.cars():
            pose = car.pose
            motion = ("-",) * 3 if pose is None else (
                f"{pose.pose.x:+.2f} {pose.pose.y:+.2f}", f"{pose.speed:+.2f}",
                f"{1e3 * pose.age:.0f}")
            cells = (car.name, car.state, *motion, _describe_car(station, car))
            # Text, because names come from the network and may contain markup.
            table.add_row(*map(Text, cells))
        for line in _format_ignored([station]):
            table.add_row("", "ignored", "", "", "", Text(line))
    return table
