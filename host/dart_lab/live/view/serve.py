"""``car.view()``: serve the live page of a car."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from math import inf
from pathlib import Path

from dart_hal.car import Car
from dart_lab.live.view.access import VIEWER_PORT, Access, load_token
from dart_lab.live.view.desk import Desk, Others
from dart_lab.live.view.server import PageServer, bind_socket
from dart_lab.live.view.told import Lines


def serve(car: Car, *, port: int = VIEWER_PORT, lan: bool = False, drives: bool = False,
          lines: Lines = None, others: Others | None = None, waive: Sequence[str] = (),
          max_throttle: float = 0.35, folder: Path = Path("runs")) -> LivePage:
    """Serve a live page of an open car, until ``close``.

    port: 0 for any free one. lan: other computers and phones may open the page. drives: a page may
    drive, in ``LivePage.run``; otherwise it shows the car and can stop it. lines (m, 4) [m]: map
    that is drawn, or one for each frame of poses. others: returns the poses of other cars, such as
    ``join(car, room).other_poses``. max_throttle: of a stick pushed to its end. folder: for
    recordings that a page starts. Raises UsageError for a port that is in use.
    """
    # The socket is bound first: a used port is refused before anything of the car is touched.
    place = bind_socket(port, lan)
    access = Access.of_this_computer(place.getsockname()[1], lan, load_token())
    desk = Desk(car, access, drives=drives, lines=lines, others=others, waive=waive,
                max_throttle=max_throttle, folder=folder)
    return LivePage(desk, place, access)


class LivePage:
    """A live page and its server; a context manager. Created by ``serve``."""

    def __init__(self, desk: Desk, place: socket.socket, access: Access) -> None:
        self.desk = desk
        self.access = access
        self._server = PageServer(place, access, desk)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page, with the token for driving."""
        return self.access.urls

    def run(self, duration: float = inf, ended: Callable[[], bool] = lambda: False) -> None:
        """Let a page drive for ``duration`` s, or until ``ended()``."""
        self.desk.run(duration, ended)

    def close(self) -> None:
        """Stop serving the page; the car stays open. Idempotent."""
        self.desk.close()
        self._server.close()

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
