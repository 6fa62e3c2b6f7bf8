"""External poses of a run of our own as the ``Mocap`` that the published recordings have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.estimation.clock import edge_under_middle, lower_hull
from dart_hal.recording.dart import Messages, Mocap, Note, Recording, fit_reference
from dart_hal.recording.dart.mocap import EPOCH_FROM
from dart_hal.recording.dart.mocap import mocap as read_mocap
from dart_hal.recording.dart.model import freeze
from dart_hal.recording.dart.reader import MIN_MOCAP_ROWS
from dart_hal.recording.dart.schema import MOCAP
from dart_hal.types import ExternalPose, FloatArray


def mocap_of(poses: Sequence[ExternalPose]) -> tuple[Mocap, float, list[Note]] | None:
    """(mocap, car's time [s] of its first row, notes); None for fewer than 30 poses.

    Rows are told by the source's stamps, brought to the car's clock by the
    promptest arrivals: what all of them were late is not seen, as it is not in
    the published recordings, whose common clock is the arrival as well.
    """
    if len(poses) < MIN_MOCAP_ROWS:
        return None
    stamp = np.array([p.stamp for p in poses])
    t, notes = car_time(stamp, np.array([p.arrival for p in poses]))
    rows = (t, *np.array([(p.x, p.y, p.yaw) for p in poses]).T)
    mocap, _, more = read_mocap(dict(zip(MOCAP, rows, strict=True)))
    epoch = float(stamp[0]) if stamp[0] > EPOCH_FROM else None
    return replace(mocap, epoch=epoch), float(t[0]), notes + more


def car_time(stamp: FloatArray, arrival: FloatArray) -> tuple[FloatArray, list[Note]]:
    """Stamps (n,) of a source on the car's clock [s], by offset and rate of the lower hull."""
    since = stamp - stamp[0]
    newest = np.maximum.accumulate(since)
    ahead = np.concatenate([[True], newest[1:] > newest[:-1]])
    if np.any(newest - since > 1.0):
        return arrival, [Note("the source of the poses began anew: told by their arrival",
                              kind="mocap_time_back")]
    pairs = list(zip(since[ahead].tolist(), arrival[ahead].tolist(), strict=True))
    (xa, ya), (xb, yb) = edge_under_middle(lower_hull(pairs))
    return ya + (yb - ya) / (xb - xa) * (since - xa), []


def on_clock(messages: Messages, start: float) -> Messages:
    """Messages whose arrival is told on the clock of a mocap that starts at ``start`` [s]."""
    return replace(messages, arrival=freeze(messages.t - start))


def marked(recording: Recording) -> Recording:
    """A run with where its marker frame sat, where its own driving tells."""
    found = fit_reference([recording])
    if found is None:
        return recording
    note = Note(f"marker frame fitted to this run: L_x {found.lx:.4f} m, "
                f"theta {found.theta:+.4f} rad (--reference gives it)", kind="marker")
    return replace(recording, marker=found, notes=(*recording.notes, note))
