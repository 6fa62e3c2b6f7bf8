"""All cars of some rooms on one page, and one STOP for all of them.

It needs no program of theirs: a station listens in each room. All of it happens in the server's
thread.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import msgspec

from dart_hal.fleet.station import Seen, Station
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import Access
from dart_lab.live.view.operator import Refused
from dart_lab.live.view.server import FLEET, Server, bound

DRIVES = 0.03
"""m/s from which an armed car is said to drive; below it the encoder has told nothing yet."""
MAX_IGNORED = 64
"""Names that are reported as ignored: a flood of names must not fill the page."""
TOLD_EVERY = 3
"""Batches: ten times a second."""

_json = msgspec.json.encode


def state_of(seen: Seen) -> str:
    """found (nothing told of its health yet), link, arming, armed, driving, refused or lost."""
    if seen.state in ("LOST", "UNKNOWN"):
        return {"LOST": "lost", "UNKNOWN": "found"}[seen.state]
    health = seen.health
    if (health is not None and health.held) or seen.state in ("TRIPPED", "LOCKED", "FAULT"):
        return "refused"
    if seen.state in ("ARMED", "RAW"):
        moves = seen.pose is not None and abs(seen.pose.speed) > DRIVES
        return "driving" if moves else "armed"
    return "arming" if seen.state == "ARMING" else "link"


def told(seen: Seen, room: str) -> dict[str, Any]:
    """One car as the page draws it."""
    health, pose = seen.health, seen.pose
    why = [] if health is None else [health.held, *sorted(health.doubts)]
    return {"name": seen.name, "room": room, "state": state_of(seen), "mode": seen.state,
            "why": "; ".join(text for text in why if text), "silent": round(seen.silent, 2),
            "lost": seen.lost,
            "pose": None if pose is None else {
                "x": round(pose.pose.x, 3), "y": round(pose.pose.y, 3),
                "yaw": round(pose.pose.yaw, 3), "frame": pose.frame,
                "speed": round(pose.speed, 2), "age": round(pose.age, 3)}}


class FleetDesk:
    """What the page of a fleet shows and does: the ``Listener`` of its server."""

    def __init__(self, stations: Sequence[Station]) -> None:
        self._stations = stations
        self._count = 0
        self._said: list[str] = []
        self._ignored: dict[str, str] = {}
        self._called: list[Any] = []

    def joined(self, page: Hashable) -> Iterable[str]:
        """The rooms; the cars come with the next batch."""
        yield _json({"type": "rooms", "rooms": [s.transport.url for s in self._stations],
                     "open": [s.transport.url for s in self._stations if not s.has_key]}).decode()

    def said(self, page: Hashable, message: m.Message) -> str | None:
        """Raises Refused for all but STOP."""
        if not isinstance(message, m.Stop):
            raise Refused("this page watches cars and stops them all; each is driven by its own")
        self._called = [station.call_stop("STOP at the page of the fleet")
                        for station in self._stations]
        self._say("STOP ALL was pressed")
        return None

    def left(self, page: Hashable) -> None:
        """Nothing of it remains."""

    def batch(self) -> Iterable[str]:
        """Listen, beat, repeat a STOP that is under way; tell ten times a second."""
        cars = [told(seen, station.transport.url) for station in self._stations
                for seen in station.watch()]
        over = [station.press() for station in self._stations]
        if self._called and all(over):
            silent = sorted(set().union(*(call.silent for call in self._called)))
            self._say(f"no answer: {', '.join(silent)}" if silent else "all cars have answered")
            self._called = []
        for station in self._stations:
            for name, why in station.ignored().items():
                if self._ignored.get(name) != why and len(self._ignored) < MAX_IGNORED:
                    self._ignored[name] = why
                    self._say(f"{name} is ignored: {why}")
        self._count += 1
        if self._count % TOLD_EVERY == 0:
            yield _json({"type": "cars", "cars": cars}).decode()
        while self._said:
            yield self.refusal(self._said.pop(0))

    def picture(self) -> bytes | None:
        """A fleet's page shows none."""
        return None

    def is_driver(self, page: Hashable) -> bool:
        """Nobody drives by the page of a fleet."""
        return False

    def refusal(self, why: str) -> str:
        """A sentence for the list of what was said."""
        return _json({"type": "said", "text": why}).decode()

    def _say(self, text: str) -> None:
        self._said.append(text)


class FleetPage:
    """The page of a fleet, served until ``close``; a context manager.

    stations: they are left open. Raises UsageError for a port that is in use.
    """

    def __init__(self, stations: Sequence[Station], port: int, lan: bool) -> None:
        place = bound(port, lan)
        self.access = Access.at(place.getsockname()[1], lan)
        self._server = Server(place, self.access, FleetDesk(stations), FLEET)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page; nobody drives by it, so there is no token."""
        return tuple(url.partition("#")[0] for url in self.access.urls)

    def close(self) -> None:
        """Idempotent."""
        self._server.close()

    def __enter__(self) -> FleetPage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
