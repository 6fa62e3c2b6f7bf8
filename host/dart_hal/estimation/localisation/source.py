"""Localisation as a source of poses, with the same interface as motion capture.

In virtual time a scan is processed when it arrives, so that a replay gives the same poses. With a
real car a thread processes it, because a search of the whole map takes longer than a frame.
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

from dart_hal.control.traffic import NearbyCar
from dart_hal.core.errors import UsageError
from dart_hal.core.types import ExternalPose, Scan, State
from dart_hal.estimation.localisation.field import Map, map_of_grid
from dart_hal.estimation.localisation.grid import read_grid
from dart_hal.estimation.localisation.health import Status
from dart_hal.estimation.localisation.localiser import Localiser, Located
from dart_hal.estimation.localisation.path import STEP_HISTORY
from dart_hal.estimation.other_cars.memory import list_possible, remember_cars
from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_hal.estimation.other_cars.sweep import make_sweep
from dart_hal.estimation.other_cars.tracker import CarTracker
from dart_hal.estimation.other_cars.tracks import CarTrack

EXPECTED = "lidar:map.yaml, or lidar:map.yaml?start=X,Y,YAW in m and rad"
FRAME = "lidar-map"
# Scans with their States that wait for the thread: 8 s; later ones are dropped.
MAX_QUEUED_SCANS = 64

Work = tuple[tuple[State, ...], Scan]


class LidarPoses:
    """``PoseSource`` of a car with a lidar; the car calls ``add_states`` and ``add``.

    ``map_std``: of its chart [m]; ``newest``: result of the last scan, None before it;
    ``dropped``: number of dropped scans; ``cars``: other cars in the scans after ``track_cars``,
    with those lost of late; ``possible``: what may be one.
    """

    on_board = True

    def __init__(self, chart: Map, start: tuple[float, float, float] | None = None,
                 name: str = "lidar") -> None:
        self.name = name
        self.chart = chart
        self.map_std = chart.std
        self.dropped = 0
        self.newest: Located | None = None
        self.cars: tuple[CarTrack, ...] = ()
        self.possible: list[NearbyCar] = []
        self._tracker: CarTracker | None = None
        self._localiser = Localiser(chart, start)
        self._states: deque[State] = deque()
        self._poses: deque[ExternalPose] = deque()
        self._work: Queue[Work | None] | None = None

    def start_thread(self) -> None:
        """Process scans in a thread from now on."""
        self._work = Queue(MAX_QUEUED_SCANS)
        threading.Thread(target=self._serve, args=(self._work,), name="localiser",
                         daemon=True).start()

    def track_cars(self, size: CarSize) -> None:
        """Track other cars of this size from the next scan on."""
        self._tracker = CarTracker(size)

    def add_states(self, states: Sequence[State]) -> None:
        """Add States of the car, each once, in order; the last seconds wait for a scan."""
        self._states.extend(states)
        while self._states and self._states[0].t < self._states[-1].t - STEP_HISTORY:
            self._states.popleft()

    def add(self, scan: Scan) -> None:
        """Process a scan, or queue it for the thread, with the States added since the last one.

        These States reach up to the arrival of the scan.
        """
        work = (tuple(self._states), scan)
        self._states.clear()
        if self._work is None:
            self._locate(*work)
            return
        try:
            self._work.put_nowait(work)
        except Full:
            self.dropped += 1

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the new poses, as ``PoseSource``: one for each localised scan."""
        out = []
        while self._poses:
            pose = self._poses.popleft()
            out.append(pose if self._work is None else replace(pose, arrival=now))
        return out

    def close(self) -> None:
        """End the thread, if any, after its current scan."""
        if self._work is not None:
            while not self._work.empty():
                self._work.get_nowait()
            self._work.put(None)

    def _serve(self, work: Queue[Work | None]) -> None:
        """Process queued scans until None comes."""
        while (item := work.get()) is not None:
            self._locate(*item)

    def _locate(self, states: tuple[State, ...], scan: Scan) -> None:
        """Localise one scan and store its pose for ``poll``; not one before time 0 of the car."""
        for state in states:
            self._localiser.update_odometry(state.t, state.pose.x, state.pose.y, state.pose.yaw,
                                       state.accel_x)
        located = self._localiser.add(scan)
        if located is None:
            # Too few echoes, or no odometry at its time.
            located = Located(scan.arrival, scan.arrival, Status.LOST, None, 0.0)
        self.newest = located
        if located.pose is not None and located.t >= 0.0:
            pose = located.pose
            if self._tracker is not None and self._localiser.beams is not None:
                sweep = make_sweep(self.chart, self._localiser.beams, pose)
                self.cars = remember_cars(self.cars, self._tracker.add(sweep), sweep,
                                          self._tracker.size)
                self.possible = list_possible(self._tracker.list_possible(located.t),
                                              self._tracker.size)
            self._poses.append(ExternalPose(located.t, located.arrival, pose.x, pose.y, pose.yaw,
                                            pose.cov, FRAME))


def open_source(text: str, chart: Map | None = None) -> LidarPoses:
    """Open ``lidar:FILE.yaml?start=X,Y,YAW``, or ``lidar?start=...`` if the map is given.

    Raises UsageError.
    """
    parts = urlsplit(text, allow_fragments=False)
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    path = parts.netloc + parts.path if parts.scheme else ""
    if bool(path) is (chart is not None) or set(options) - {"start"}:
        raise UsageError(f"{text!r} names no map for localisation", found=text, expected=EXPECTED)
    start = parse_start(options["start"]) if "start" in options else None
    return LidarPoses(chart or map_of_grid(read_grid(Path(path))), start, text)


def parse_start(text: str) -> tuple[float, float, float]:
    """Parse X,Y,YAW [m, m, rad]. Raises UsageError."""
    try:
        x, y, yaw = (float(word) for word in text.split(","))
    except ValueError as why:
        raise UsageError(f"start={text} is no pose", found=text, expected="X,Y,YAW") from why
    if not all(map(isfinite, (x, y, yaw))):
        raise UsageError(f"start={text} is no pose", found=text, expected="finite numbers")
    return x, y, yaw
