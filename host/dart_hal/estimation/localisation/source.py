"""The localiser as a source of poses: a controller cannot tell it from motion capture.

In virtual time a scan is worked on where it comes, so that a replay gives the same poses; with a
real car a thread does it, since a search of the whole map takes longer than a frame may wait.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from queue import Full, Queue
from urllib.parse import parse_qsl, urlsplit

from dart_hal.core.errors import UsageError
from dart_hal.core.types import ExternalPose, Scan, State
from dart_hal.estimation.localisation.field import Map, map_of_grid
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.estimation.localisation.localiser import Localiser, Located

EXPECTED = "lidar:map.yaml, or lidar:map.yaml?start=X,Y,YAW in m and rad"
FRAME = "lidar-map"
KEPT = 64
"""Scans and their States that wait for the thread: 8 s; what comes then is dropped."""

Work = tuple[tuple[State, ...], Scan]


class LidarPoses:
    """``PoseSource`` of a car with a lidar; the car feeds ``moved`` and ``add``.

    ``newest``: what the last scan told, None before it; ``dropped``: scans that were too many.
    """

    on_board = True

    def __init__(self, chart: Map, start: tuple[float, float, float] | None = None,
                 name: str = "lidar") -> None:
        self.name, self.chart, self.dropped = name, chart, 0
        self.newest: Located | None = None
        self._localiser = Localiser(chart, start)
        self._states: list[State] = []
        self._told: deque[ExternalPose] = deque()
        self._work: Queue[Work | None] | None = None

    def in_thread(self) -> None:
        """From now on scans are worked on beside the car's own loop."""
        self._work = Queue(KEPT)
        threading.Thread(target=self._serve, args=(self._work,), name="localiser",
                         daemon=True).start()

    def moved(self, states: Sequence[State]) -> None:
        """States of the car, each once, in order."""
        self._states.extend(states)

    def add(self, scan: Scan) -> None:
        """A scan that was whole when those States were there."""
        work, self._states = (tuple(self._states), scan), []
        if self._work is None:
            self._locate(*work)
            return
        try:
            self._work.put_nowait(work)
        except Full:
            self.dropped += 1

    def poll(self, now: float) -> list[ExternalPose]:
        """As ``PoseSource``: one for each scan that was placed."""
        out = []
        while self._told:
            pose = self._told.popleft()
            out.append(pose if self._work is None else replace(pose, arrival=now))
        return out

    def close(self) -> None:
        """The thread, if any, ends with the scan that it has."""
        if self._work is not None:
            while not self._work.empty():
                self._work.get_nowait()
            self._work.put(None)

    def _serve(self, work: Queue[Work | None]) -> None:
        while (item := work.get()) is not None:
            self._locate(*item)

    def _locate(self, states: tuple[State, ...], scan: Scan) -> None:
        for state in states:
            self._localiser.moved(state.t, state.pose.x, state.pose.y, state.pose.yaw,
                                  state.accel_x)
        told = self._localiser.add(scan)
        self.newest = told or self.newest
        if told is not None and told.pose is not None and told.t >= 0.0:
            at = told.pose
            self._told.append(ExternalPose(told.t, told.arrival, at.x, at.y, at.yaw, at.cov,
                                           FRAME))


def open_source(text: str, chart: Map | None = None) -> LidarPoses:
    """``lidar:FILE.yaml?start=X,Y,YAW``, or ``lidar?start=...`` where the map is given.

    Raises UsageError.
    """
    parts = urlsplit(text, allow_fragments=False)
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    path = parts.netloc + parts.path if parts.scheme else ""
    if bool(path) is (chart is not None) or set(options) - {"start"}:
        raise UsageError(f"{text!r} is no map to be localised in", found=text, expected=EXPECTED)
    start = start_of(options["start"]) if "start" in options else None
    return LidarPoses(chart or map_of_grid(read_grid(Path(path))), start, text)


def start_of(text: str) -> tuple[float, float, float]:
    """X,Y,YAW [m, m, rad]. Raises UsageError."""
    try:
        x, y, yaw = (float(word) for word in text.split(","))
    except ValueError as why:
        raise UsageError(f"start={text} is no pose", found=text, expected="X,Y,YAW") from why
    if not all(map(isfinite, (x, y, yaw))):
        raise UsageError(f"start={text} is no pose", found=text, expected="finite numbers")
    return x, y, yaw
