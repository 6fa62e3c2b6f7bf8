"""Play a recorded run on the live page: it is sent at once, and the page has a time bar."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Hashable, Iterable
from math import ceil
from pathlib import Path
from typing import Any

import msgspec

from dart_hal.car import Car
from dart_hal.core.types import Scan
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import Access
from dart_lab.live.view.operator import Refused
from dart_lab.live.view.rows import FIELDS, Row, scan_points, state_row
from dart_lab.live.view.server import PageServer, bind_socket

# An hour at 100 Hz: 40 MB of JSON, the limit of a browser page.
MAX_RUN_ROWS = 360_000
# All images together: two and a half minutes of the emulated camera.
MAX_IMAGE_BYTES = 12_000_000


def run_of(car: Car) -> dict[str, Any]:
    """Return the message with a recorded run.

    It has rows of ``FIELDS`` and, for each new scan, the index of its row and its points, likewise
    for images. Images are omitted evenly so that they have at most MAX_IMAGE_BYTES. Only the first
    hour is included.
    """
    rows: list[Row] = []
    scans: list[tuple[int, list[float]]] = []
    images: list[tuple[int, bytes]] = []
    last: Scan | None = None
    for state in car.states():
        rows.append(state_row(state, None))
        if state.scan is not None and state.scan is not last:
            last = state.scan
            scans.append((len(rows) - 1, scan_points(last, state)))
        if state.image is not None and (not images or images[-1][1] is not state.image.jpeg):
            images.append((len(rows) - 1, state.image.jpeg))
        if len(rows) == MAX_RUN_ROWS:
            break
    return {"type": "run", "car": car.files.config.name, "url": car.url, "fields": FIELDS,
            "rows": rows, "scans": scans,
            "images": [(n, b64encode(jpeg).decode()) for n, jpeg in thin_images(images)]}


def thin_images(images: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """Return every n-th image, with the smallest n for which they fit MAX_IMAGE_BYTES."""
    step = ceil(sum(len(jpeg) for _, jpeg in images) / MAX_IMAGE_BYTES)
    return images[::max(step, 1)]


def save(run: dict[str, Any], path: Path) -> Path:
    """Write the run to a file. With it the page needs no server: ``index.html?run=run.json``."""
    path.write_text(json.dumps(run, separators=(",", ":")), encoding="utf-8")
    return path


class Player:
    """Serves a run until ``close``; a context manager.

    second: another run, shown at the same time since its start.
    """

    def __init__(self, run: dict[str, Any], port: int, lan: bool,
                 second: dict[str, Any] | None = None) -> None:
        self._run = msgspec.json.encode(run | {"second": second}).decode()
        bound = bind_socket(port, lan)
        self.access = Access.of_this_computer(bound.getsockname()[1], lan)
        self._server = PageServer(bound, self.access, self)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page."""
        return tuple(url.partition("#")[0] for url in self.access.urls)

    def open_page(self, page: Hashable) -> Iterable[str]:
        """Return the run as the only message."""
        yield self._run

    def handle_message(self, page: Hashable, message: m.Message) -> str | None:
        """Raise Refused: a recording cannot be driven or stopped."""
        raise Refused("this is a recording: it cannot be driven or stopped")

    def close_page(self, page: Hashable) -> None:
        """Do nothing: a player keeps no state of a page."""

    def batch(self) -> Iterable[str]:
        """Return no messages: a recording does not change."""
        return ()

    def is_driver(self, page: Hashable) -> bool:
        """Return False: a recording has no driver."""
        return False

    def refusal(self, why: str) -> str:
        """Return a message for the list of notices of the page."""
        return msgspec.json.encode({"type": "said", "text": why}).decode()

    def picture(self) -> bytes | None:
        """Return None: the images are part of the run."""
        return None

    def close(self) -> None:
        """Stop serving the run. Idempotent."""
        self._server.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
