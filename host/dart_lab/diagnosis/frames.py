"""Marker frames that were fitted to the recordings: free in every fit, within their errors.

A fit of the marker frame knows no more of the car than a linear rear tyre, so it is off by some
millimetres. Beside that error a wrong name may explain what is left: `yaw_damping`, a turned
steering gain. The offsets of the frame are therefore estimated together with everything else. The
prior is the standard error that the frame states. They are of these recordings: no model file has
them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from dart_hal.recording.dart import Recording
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import unit, value
from dart_hal.vehicle.parameters import Vehicle

FRAME_EFFECTS = {"mocap_offset_x": 0, "mocap_yaw": 1, "mocap_offset_y": 2}
"""Effects that move a marker frame, with the place of their standard error in ``Reference.std``."""


def find_frame_errors(recordings: Sequence[Recording]) -> dict[str, float]:
    """Find the standard errors of the marker frame that all recordings share, by parameter.

    Empty where it is known, or where recordings have different frames: the offset of one mounting
    says nothing about another.
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
    """Say by how much a fit moves the marker frame, in one note; none where it is known."""
    if not errors:
        return ()
    moved = ", ".join(f"{name.partition('.')[0]} {value(vehicle, name):+.4f} {unit(vehicle, name)}"
                      for name in errors)
    return (f"the marker frame was fitted to these recordings; the fit of the model moves it, "
            f"within its stated errors, by {moved}",)
