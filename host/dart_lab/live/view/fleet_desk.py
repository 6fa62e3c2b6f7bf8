"""One page with all cars of some fleet rooms, and one STOP for all of them.

A station listens in each room; the programs of the cars need not know of the page. All calls happen
in the thread of the server.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import msgspec

from dart_hal.core.types import START_FRAME
from dart_hal.fleet.station import CarStatus, Station
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import Access
from dart_lab.live.view.operator import Refused
from dart_lab.live.view.server import FLEET_PAGE_FILES, PageServer, bind_socket

# m/s from which an armed car counts as driving. Below it the encoder has sent no edge yet.
MIN_DRIVING_SPEED = 0.03
# Names that are reported as ignored. The limit keeps a flood of names off the page.
MAX_IGNORED = 64
# Ten reports a second.
BATCHES_PER_REPORT = 3
_json = msgspec.json.encode


def describe_state(status: CarStatus) -> str:
    """Return found (no health yet), link, arming, armed, driving, refused or lost."""
    if status.state in ("LOST", "UNKNOWN"):
        return {"LOST": "lost", "UNKNOWN": "found"}[status.state]
    health = status.health
    if (health is not None and health.held) or status.state in ("TRIPPED", "LOCKED", "FAULT"):
        return "refused"
    if status.state in ("ARMED", "RAW"):
        moves = status.pose is not None and abs(status.pose.speed) > MIN_DRIVING_SPEED
        return "driving" if moves else "armed"
    return "arming" if status.state == "ARMING" else "link"


def car_json(status: CarStatus, room: str) -> dict[str, Any]:
    """Return a car as JSON for the page."""
    health = status.health
    pose = status.pose
    why = [] if health is None else [health.held, *sorted(health.doubts)]
    return {"name": status.name, "room": room, "state": describe_state(status),
            "mode": status.state, "why": "; ".join(text for text in why if text),
            "silent": round(status.silent, 2), "lost": status.lost,
            "battery": None if health is None else health.battery,
            "pose": None if pose is None else {
                "x": round(pose.pose.x, 3), "y": round(pose.pose.y, 3),
                "yaw": round(pose.pose.yaw, 3), "frame": pose.frame,
                "own_frame": pose.frame == START_FRAME,
                "speed": round(pose.speed, 2), "age": round(pose.age, 3)}}


class FleetDesk:
    """Content and actions of the page of a fleet: the ``PageListener`` of its server."""

    def __init__(self, stations: Sequence[Station]) -> None:
        self._stations = stations
        self._count = 0
        self._reports: list[str] = []
        self._ignored: dict[str, str] = {}
        self._stop_calls: list[Any] = []

    def open_page(self, page: Hashable) -> Iterable[str]:
        """Return the message with the rooms; the cars follow in the next batch."""
        yield _json({"type": "rooms", "rooms": [s.transport.url for s in self._stations],
                     "open": [s.transport.url for s in self._stations if not s.has_key]}).decode()

    def handle_message(self, page: Hashable, message: m.Message) -> str | None:
        """Stop all cars for STOP; raise Refused for other messages."""
        if not isinstance(message, m.Stop):
            raise Refused("this page shows all cars and stops them; to drive a car, open its own "
                          "page")
        self._stop_calls = [station.call_stop("STOP at the page of the fleet")
                            for station in self._stations]
        self._report("STOP ALL was pressed")
        return None

    def close_page(self, page: Hashable) -> None:
        """Do nothing: no state of a page is kept."""

    def batch(self) -> Iterable[str]:
        """Receive, send the watch signal, repeat a STOP; report cars ten times a second."""
        cars = [car_json(status, station.transport.url) for station in self._stations
                for status in station.watch()]
        finished = [station.press() for station in self._stations]
        if self._stop_calls and all(finished):
            silent = sorted(set().union(*(call.silent for call in self._stop_calls)))
            self._report(f"no answer: {', '.join(silent)}" if silent else "all cars have answered")
            self._stop_calls = []
        for station in self._stations:
            for name, why in station.list_ignored().items():
                if self._ignored.get(name) != why and len(self._ignored) < MAX_IGNORED:
                    self._ignored[name] = why
                    self._report(f"{name} is ignored: {why}")
        self._count += 1
        if self._count % BATCHES_PER_REPORT == 0:
            yield _json({"type": "cars", "cars": cars}).decode()
        while self._reports:
            yield self.refusal(self._reports.pop(0))

    def picture(self) -> bytes | None:
        """Return None: the page of a fleet shows no images."""
        return None

    def is_driver(self, page: Hashable) -> bool:
        """Return False: the page of a fleet drives no car."""
        return False

    def refusal(self, why: str) -> str:
        """Return a message for the list of notices of the page."""
        return _json({"type": "said", "text": why}).decode()

    def _report(self, text: str) -> None:
        self._reports.append(text)


class FleetPage:
    """The page of a fleet, served until ``close``; a context manager.

    stations: they stay open. Raises UsageError for a port that is in use.
    """

    def __init__(self, stations: Sequence[Station], port: int, lan: bool) -> None:
        bound = bind_socket(port, lan)
        self.access = Access.of_this_computer(bound.getsockname()[1], lan)
        self._server = PageServer(bound, self.access, FleetDesk(stations), FLEET_PAGE_FILES)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page, without a token because it cannot drive."""
        return tuple(url.partition("#")[0] for url in self.access.urls)

    def close(self) -> None:
        """Stop serving the page. Idempotent."""
        self._server.close()

    def __enter__(self) -> FleetPage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
