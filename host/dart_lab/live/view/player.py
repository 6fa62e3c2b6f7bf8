"""A recorded run on the same page: all of it is sent at once, and the page has the time bar."""

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
from dart_lab.live.view.rows import FIELDS, Row, points, row
from dart_lab.live.view.server import Server, bound

MOST_ROWS = 360_000
"""An hour at 100 Hz, 40 MB of JSON: more is no page."""

MOST_PICTURES = 12_000_000
"""Bytes of images: two and a half minutes of the emulated camera, all of them."""


def run_of(car: Car) -> dict[str, Any]:
    """The message with a whole recorded run: rows of ``FIELDS`` and, for each new scan, the index
    of its row and its points; likewise for images, of which so many are left out evenly that they
    have ``MOST_PICTURES`` bytes. What of it is longer than an hour is left out."""
    rows: list[Row] = []
    scans: list[tuple[int, list[float]]] = []
    images: list[tuple[int, bytes]] = []
    last: Scan | None = None
    for state in car.states():
        rows.append(row(state, None))
        if state.scan is not None and state.scan is not last:
            last = state.scan
            scans.append((len(rows) - 1, points(last, state)))
        if state.image is not None and (not images or images[-1][1] is not state.image.jpeg):
            images.append((len(rows) - 1, state.image.jpeg))
        if len(rows) == MOST_ROWS:
            break
    return {"type": "run", "car": car.files.config.name, "url": car.url, "fields": FIELDS,
            "rows": rows, "scans": scans,
            "images": [(n, b64encode(jpeg).decode()) for n, jpeg in thinned(images)]}


def thinned(images: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """Every n-th of them, as few as must be left out."""
    each = ceil(sum(len(jpeg) for _, jpeg in images) / MOST_PICTURES)
    return images[::max(each, 1)]


def save(run: dict[str, Any], path: Path) -> Path:
    """As a file beside the page, which then needs no server: ``index.html?run=run.json``."""
    path.write_text(json.dumps(run, separators=(",", ":")), encoding="utf-8")
    return path


class Player:
    """Serves a run until ``close``; a context manager."""

    def __init__(self, run: dict[str, Any], port: int, lan: bool) -> None:
        self._run = msgspec.json.encode(run).decode()
        place = bound(port, lan)
        self.access = Access.at(place.getsockname()[1], lan)
        self._server = Server(place, self.access, self)
        self._server.start()

    @property
    def urls(self) -> tuple[str, ...]:
        """Addresses of the page."""
        return tuple(url.partition("#")[0] for url in self.access.urls)

    def joined(self, page: Hashable) -> Iterable[str]:
        """The run."""
        yield self._run

    def said(self, page: Hashable, message: m.Message) -> str | None:
        """Raises Refused: a recording obeys nobody."""
        raise Refused("this is a recording: there is nothing to drive or to stop")

    def left(self, page: Hashable) -> None:
        """Nothing of it remains."""

    def batch(self) -> Iterable[str]:
        """Nothing happens in a recording."""
        return ()

    def is_driver(self, page: Hashable) -> bool:
        """Nobody drives a recording."""
        return False

    def refusal(self, why: str) -> str:
        """A sentence for the list of what was said."""
        return msgspec.json.encode({"type": "said", "text": why}).decode()

    def picture(self) -> bytes | None:
        """Its images are in the run."""
        return None

    def close(self) -> None:
        """Idempotent."""
        self._server.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
