"""The mass that the forces of a fit hang on: as weighed with the recordings, if it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.recording.dart import RUN, Recording
from dart_hal.vehicle import Vehicle
from dart_lab.identification.fit import Estimate

AGREE = 3.0  # standard errors; masses farther apart are loads, not errors of a scale


def weighed(recordings: Sequence[Recording]) -> Estimate | None:
    """The mean [kg] of what runs of our own were weighed at, by their errors.

    None when none was, or when other recordings are among them: those are of
    another car. Masses that differ widen the error to their spread.
    """
    known = [r.mass for r in recordings if r.mass is not None]
    if not known or any(r.schema != RUN for r in recordings):
        return None
    value, std = np.array(known).T
    weight = 1.0 / std**2
    mean = float(weight @ value / weight.sum())
    spread = float(np.abs(value - mean).max())
    own = float(std.min())  # one scale: its error is common to all
    return Estimate(mean, own if spread < AGREE * own else max(own, spread), "kg")


def never_weighed(recordings: Sequence[Recording], base: Vehicle) -> str:
    """What to say of runs whose car nobody has weighed; else empty."""
    runs = [r for r in recordings if r.schema == RUN]
    if not runs or weighed(recordings) is not None:
        return ""
    return (f"nobody has weighed this car with these runs: {base.body.mass:g} kg is the base's; "
            "each per cent that it is off is one in a, c, d and e (dart-hal experiment --mass "
            "KG puts it into the recording)")


def of_mass(vehicle: Vehicle, mass: Estimate | None) -> Vehicle:
    """The vehicle with this mass."""
    return vehicle if mass is None else replace(
        vehicle, body=replace(vehicle.body, mass=mass.value))
