"""External poses of a run as the ``Mocap`` of the published DART recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.config import Calibration
from dart_hal.core.types import ExternalPose
from dart_hal.estimation.source_clock import to_car_time
from dart_hal.recording.dart import Messages, Mocap, Note, Reference
from dart_hal.recording.dart.mocap import EPOCH_FROM
from dart_hal.recording.dart.mocap import mocap as read_mocap
from dart_hal.recording.dart.model import freeze
from dart_hal.recording.dart.reader import MIN_MOCAP_ROWS
from dart_hal.recording.dart.schema import MOCAP_COLUMNS


def mocap_from_poses(poses: Sequence[ExternalPose]) -> tuple[Mocap, float, list[Note]] | None:
    """Return (mocap, car's time [s] of its first row, notes); None for fewer than 30 poses.

    The rows have the times of the source, mapped to the car's clock by the arrivals with the least
    delay. A delay common to all poses remains, as in the published recordings, whose common clock
    is the arrival as well.
    """
    if len(poses) < MIN_MOCAP_ROWS:
        return None
    stamp = np.array([p.stamp for p in poses])
    t, restarts = to_car_time(stamp, np.array([p.arrival for p in poses]))
    notes = [Note(restarts, kind="mocap_time_back")] if restarts else []
    rows = (t, *np.array([(p.x, p.y, p.yaw) for p in poses]).T)
    mocap, _, more = read_mocap(dict(zip(MOCAP_COLUMNS, rows, strict=True)))
    epoch = float(stamp[0]) if stamp[0] > EPOCH_FROM else None
    return replace(mocap, epoch=epoch), float(t[0]), notes + more


def shift_arrivals(messages: Messages, start: float) -> Messages:
    """Return messages with arrivals on the clock of a mocap that starts at ``start`` [s]."""
    return replace(messages, arrival=freeze(messages.t - start))


def marker_calibration(calibration: Calibration | None) -> tuple[Reference, float] | None:
    """Return (marker frame, latency [s]) of ``calibrate mocap``; None: not calibrated."""
    table = calibration.mocap if calibration else None
    if table is None or not (table.marker_x and table.marker_y and table.marker_yaw):
        return None
    marker = Reference(table.marker_x.value, table.marker_yaw.value, table.marker_y.value,
                       "calibrate mocap",
                       (table.marker_x.std, table.marker_yaw.std, table.marker_y.std))
    return marker, table.latency.value if table.latency else 0.0
