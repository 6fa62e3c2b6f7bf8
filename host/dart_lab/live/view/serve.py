"""``car.view()``: a car's live page, served."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path

from dart_hal.car import Car
from dart_lab.live.view.access import PORT, Access
from dart_lab.live.view.desk import Desk, Others
from dart_lab.live.view.server import Server, bound
from dart_lab.live.view.told import Lines


def serve(car: Car, *, port: int = PORT, lan: bool = False, drives: bool = False,
          lines: Lines = None, others: Others | None = None, waive: Sequence[str] = (),
          max_throttle: float = 0.35, folder: Path = Path("runs")) -> LivePage:
    """Serve a live page of an open car, until ``close``.

    port: 0 takes any that is free. lan: other computers and phones may open it. drives: a page may
    drive, in ``LivePage.run``; else it watches, and stops what the program does. lines (m, 4) [m]:
    the map that is drawn, or one for each frame of poses. others: tells where other cars are, such
    as ``join(car, room).other_poses``. max_throttle: of a stick that is pushed to its end. folder:
    where recordings go that a page begins. Raises UsageError for a port that is in use.
    """
    place = bound(port, lan)
    access = Access.at(place.getsockname()[1], lan)
    desk = Desk(car, access, drives=drives, lines=lines, others=others, waive=waive,
                max_throttle=max_throttle, folder=folder)
    return LivePage(desk, place, access)


class LivePage:
    """A desk and its sockets; a context manager. Made by ``serve``."""

    def __init__(self, desk: Desk, place: socket.socket, access: Access) -> None:
        self.desk, self.access = desk, access
        self._server = Server(place, access, desk)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses to open, with the token of who drives."""
        return self.access.urls

    def run(self, duration: float = inf, ended: Callable[[], bool] = lambda: False) -> None:
        """Let a page drive for ``duration`` s, or until ``ended()``."""
        self.desk.run(duration, ended)

    def close(self) -> None:
        """End the page; the car stays open. Idempotent."""
        self.desk.close()
        self._server.close()

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
