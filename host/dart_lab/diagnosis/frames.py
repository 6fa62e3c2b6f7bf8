"""Marker frames that were fitted to the recordings: free in every fit, within their errors.

The fit of a marker frame assumes a linear rear tyre, so its error is some millimetres. With that
error a wrong effect may fit the residuals, for example `yaw_damping`. Every fit therefore estimates
the offsets of the frame, with the standard errors of the frame as prior. They belong to these
recordings and are not written to a model file.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from dart_hal.recording.dart import Recording
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import Vehicle

# Effects that move a marker frame, with the place of their standard error in ``Reference.std``.
FRAME_EFFECTS = {"mocap_offset_x": 0, "mocap_yaw": 1, "mocap_offset_y": 2}


def find_frame_errors(recordings: Sequence[Recording]) -> dict[str, float]:
    """Find the standard errors of the marker frame that all recordings share, by parameter.

    Empty if it is known, or if recordings have different frames with independent offsets.
    """
    markers = [r.marker for r in recordings]
    first = markers[0] if markers else None
    if first is None or first.std is None:
        return {}
    if any(m is None or (m.lx, m.theta, m.ly) != (first.lx, first.theta, first.ly)
           for m in markers):
        return {}
    return {f"{name}.k": float(first.std[i]) for name, i in FRAME_EFFECTS.items()
            if np.isfinite(first.std[i]) and first.std[i] > 0.0}


def free_frame(vehicle: Vehicle, errors: Collection[str]) -> Vehicle:
    """Return the vehicle with an offset of 0 for each parameter of ``find_frame_errors``."""
    has = {a.name for a in vehicle.effects}
    for name in FRAME_EFFECTS:
        if f"{name}.k" in errors and name not in has:
            vehicle = apply(vehicle, name)
    return vehicle


def describe_frame(vehicle: Vehicle, errors: Collection[str]) -> tuple[str, ...]:
    """Return a note of how far a fit moves the marker frame; none if it is known."""
    if not errors:
        return ()
    moved = ", ".join(f"{name.partition('.')[0]} {value(vehicle, name):+.4f} {unit(vehicle, name)}"
                      for name in errors)
    return (f"the marker frame was fitted to these recordings; the fit of the model moves it, "
            f"within its stated errors, by {moved}",)
