"""External poses of an open car: polled at each chunk, recorded, tracked, and put into States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from dart_hal.car.lidar import CarLidar, list_map_errors, mount_std
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import PoseSource
from dart_hal.core.types import ExternalPose, State
from dart_hal.devices.links.base import Backend

if TYPE_CHECKING:
    from dart_hal.estimation.localisation.source import LidarPoses
    from dart_hal.estimation.odometry import Odometry
    from dart_hal.estimation.room import ExternalPoseEstimator


class PoseFeed:
    """Source of poses of one open car. ``record`` is called with each pose."""

    def __init__(self, source: PoseSource, room: ExternalPoseEstimator) -> None:
        # Imported here: a car without poses needs no code of their sources.
        from dart_hal.devices.poses.clock_steps import ClockStepFilter

        self.source = source
        self.record: Callable[[ExternalPose], None] = lambda pose: None
        self._room = room
        self._clock = ClockStepFilter()
        self._waiting: deque[ExternalPose] = deque()

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """Return the States of a chunk; the newest has the estimate from all poses until then.

        Later poses wait for the next chunk, so that a replay, which has only the arrival times,
        gives the same States. t: arrival of the chunk [s]; now: time [s] of the car's clock.
        """
        self._waiting.extend(self.source.poll(now))
        while self._waiting and self._waiting[0].arrival <= t:
            pose = self._waiting.popleft()
            self.record(pose)
            corrected = self._clock.correct(pose)
            if corrected is not None:
                self._room.add(corrected)
        if states:
            states[-1] = replace(states[-1], external=self._room.estimate_at(states[-1].t))
        return states


def room_of(files: CarFiles, odometry: Odometry, source: PoseSource) -> ExternalPoseEstimator:
    """Return the estimator of the pose in the room, with the marker of ``calibrate mocap``.

    Without a calibration the estimator identifies the marker itself.
    """
    # Imported here: a car without poses needs no filter of them.
    from dart_hal.estimation.pose_model import MarkerModel
    from dart_hal.estimation.room import UNKNOWN_MARKER, ExternalPoseEstimator, make_axle_marker

    if source.on_board:
        return ExternalPoseEstimator(odometry, make_axle_marker(mount_std(files)), own_clock=True,
                                     map_errors=list_map_errors(source.map_std))
    table = files.calibration.mocap if files.calibration else None
    if table is None:
        return ExternalPoseEstimator(odometry)
    known = table.marker_x, table.marker_y, table.marker_yaw, table.latency
    lx, ly, theta, latency = (quantity.value if quantity else unknown
                              for quantity, unknown in zip(known, UNKNOWN_MARKER[:4], strict=True))
    a, b, c, d = (quantity.std if quantity else unknown
                  for quantity, unknown in zip(known, UNKNOWN_MARKER.std, strict=True))
    return ExternalPoseEstimator(odometry, MarkerModel(lx, ly, theta, latency, (a, b, c, d)))


def localiser_of(backend: Backend, lidar: CarLidar | None) -> LidarPoses | None:
    """Connect the car's own lidar, if that is the source of poses, to its scans.

    Returns the source, None for another one. Raises UsageError for a car without a lidar.
    """
    source = backend.poses
    if source is None or not source.on_board:
        return None
    from dart_hal.estimation.localisation.source import LidarPoses

    if not isinstance(source, LidarPoses):
        return None
    if lidar is None:
        raise UsageError(f"poses by {source.name}: the car has no lidar", found=backend.url.text,
                         expected="sim://?lidar=1, or --lidar serial:///dev/dart-lidar")
    lidar.localiser = source
    if not backend.virtual:
        source.start_thread()
    return source


def attach_poses(backend: Backend, poses: str | PoseSource | None) -> None:
    """Attach ``poses``, else $DART_HAL_POSES, to a backend that has no source of its own.

    A recording keeps its own poses. Raises what ``open_poses`` raises.
    """
    if poses is None and backend.poses is None and backend.bus is not None:
        poses = os.environ.get("DART_HAL_POSES") or None
    if poses is not None:
        backend.poses = _open_source(poses) if isinstance(poses, str) else poses
    if backend.poses is not None:
        backend.closers += (backend.poses.close,)


def _open_source(text: str) -> PoseSource:
    if not text.startswith("lidar:"):
        from dart_hal.devices.poses import open_poses

        return open_poses(text)
    from dart_hal.estimation.localisation.source import open_source

    return open_source(text)
