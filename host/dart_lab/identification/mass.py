"""The mass that scales the forces of a fit: weighed with the recordings, or the base's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.recording.dart import RUN, Recording
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import FittedParameter

# [standard errors] Larger differences are other loads, not errors of the scale.
MAX_MASS_DEVIATION = 3.0


def average_mass(recordings: Sequence[Recording]) -> FittedParameter | None:
    """Average the masses [kg] of own runs, weighted by their errors.

    None if no car was weighed, or with recordings of other schemas: those are of another car.
    The error is at least the spread of masses that differ.
    """
    known = [r.mass for r in recordings if r.mass is not None]
    if not known or any(r.schema != RUN for r in recordings):
        return None
    value, std = np.array(known).T
    weight = 1.0 / std**2
    mean = float(weight @ value / weight.sum())
    spread = float(np.abs(value - mean).max())
    # All were weighed on one scale, whose error does not average out.
    own = float(std.min())
    return FittedParameter(mean, own if spread < MAX_MASS_DEVIATION * own else max(own, spread),
                           "kg")


def note_unweighed(recordings: Sequence[Recording], base: Vehicle) -> str:
    """Return a note on own runs whose car was not weighed; else empty."""
    runs = [r for r in recordings if r.schema == RUN]
    if not runs or average_mass(recordings) is not None:
        return ""
    return (f"the car was not weighed with these runs: {base.body.mass:g} kg is the base's; "
            "1 % of error in it is 1 % in a, c, d and e (dart-hal experiment --mass KG stores the "
            "mass in the recording)")


def replace_mass(vehicle: Vehicle, mass: FittedParameter | None) -> Vehicle:
    """Replace the mass of the vehicle, unless it is None."""
    return vehicle if mass is None else replace(
        vehicle, body=replace(vehicle.body, mass=mass.value))
