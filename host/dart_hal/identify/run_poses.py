"""External poses of a run of our own as the ``Mocap`` that the published recordings have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dart_hal.config import Calibration
from dart_hal.estimation.source_clock import car_time
from dart_hal.recording.dart import Messages, Mocap, Note, Recording, Reference, fit_reference
from dart_hal.recording.dart.marker import marker_grid
from dart_hal.recording.dart.mocap import EPOCH_FROM
from dart_hal.recording.dart.mocap import mocap as read_mocap
from dart_hal.recording.dart.model import freeze
from dart_hal.recording.dart.reader import MIN_MOCAP_ROWS
from dart_hal.recording.dart.reference import MAX_LATERAL, MIN_SAMPLES, MIN_SPEED
from dart_hal.recording.dart.schema import MOCAP
from dart_hal.types import SAMPLE, ExternalPose, FloatArray

COUNTED = 10  # samples over which the encoder of a message counted


def mocap_of(poses: Sequence[ExternalPose]) -> tuple[Mocap, float, list[Note]] | None:
    """(mocap, car's time [s] of its first row, notes); None for fewer than 30 poses.

    Rows are told by the source's stamps, brought to the car's clock by the
    promptest arrivals: what all of them were late is not seen, as it is not in
    the published recordings, whose common clock is the arrival as well.
    """
    if len(poses) < MIN_MOCAP_ROWS:
        return None
    stamp = np.array([p.stamp for p in poses])
    t, anew = car_time(stamp, np.array([p.arrival for p in poses]))
    notes = [Note(anew, kind="mocap_time_back")] if anew else []
    rows = (t, *np.array([(p.x, p.y, p.yaw) for p in poses]).T)
    mocap, _, more = read_mocap(dict(zip(MOCAP, rows, strict=True)))
    epoch = float(stamp[0]) if stamp[0] > EPOCH_FROM else None
    return replace(mocap, epoch=epoch), float(t[0]), notes + more


def on_clock(messages: Messages, start: float) -> Messages:
    """Messages whose arrival is told on the clock of a mocap that starts at ``start`` [s]."""
    return replace(messages, arrival=freeze(messages.t - start))


def calibrated(calibration: Calibration | None) -> tuple[Reference, float] | None:
    """(marker frame, latency [s] of the poses) as ``calibrate mocap`` has measured them."""
    table = calibration.mocap if calibration else None
    if table is None or not (table.marker_x and table.marker_y and table.marker_yaw):
        return None
    marker = Reference(table.marker_x.value, table.marker_yaw.value, table.marker_y.value,
                       "calibrate mocap")
    return marker, table.latency.value if table.latency else 0.0


def marked(recording: Recording) -> Recording:
    """A run with where its marker frame sat, where its own driving tells."""
    found = fit_reference([recording])
    if found is None:
        return recording
    found = replace(found, ly=_across(recording, found.theta))
    note = Note(f"marker frame fitted to this run: L_x {found.lx:.4f} m, theta {found.theta:+.4f} "
                f"rad, L_y {found.ly:+.4f} m (--reference gives it)", kind="marker")
    return replace(recording, marker=found, notes=(*recording.notes, note))


def _across(recording: Recording, theta: float) -> float:
    """L_y [m] by least squares, 0 where the wheels are not known to have turned.

        v_long = s v_wheel - L_y omega      v_wheel > 0.3 m/s, |v_long omega| < 2 m/s2

    all three means over the 0.1 s in which the encoder counted, s its scale; theta [rad]: of the
    marker frame.
    """
    g, m = marker_grid(recording), recording.messages
    yaw, end = g.yaw + theta, m.arrival / SAMPLE
    along = np.cos(yaw) * g.dx + np.sin(yaw) * g.dy
    v_long, omega, bad = (_mean(series, end) for series in (along, g.omega, g.bad))
    use = ((bad == 0.0) & (m.speed > MIN_SPEED) & (np.abs(v_long * omega) < MAX_LATERAL)
           & (end > COUNTED) & (end < len(g.t) - 1))
    if use.sum() < MIN_SAMPLES:
        return 0.0
    design = np.column_stack([m.speed, -omega])[use]
    return float(np.linalg.lstsq(design, v_long[use], rcond=None)[0][1])


def _mean(series: Any, end: FloatArray) -> FloatArray:
    """Of a series (n,), over the COUNTED samples before each end (m,)."""
    way = np.concatenate([[0.0], np.cumsum(0.5 * (series[1:] + 1.0 * series[:-1]))])
    here, before = (np.interp(at, np.arange(len(way)), way) for at in (end, end - COUNTED))
    return np.asarray((here - before) / COUNTED)
