"""Refuse recordings of several cars where they would be pooled as those of one."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.core.errors import RecordingError

from .model import Recording

# Recordings that are named in the message for each car.
MAX_NAMED_RECORDINGS = 3


def refuse_several_cars(recordings: Sequence[Recording]) -> None:
    """Raise RecordingError if the recordings state different cars, or scales of the steering.

    A fit to two cars finds the mean of both, and a diagnosis a cause that neither has. The same
    holds for logs whose maps state different angles of the command 1. Recordings without a car
    file, or without such an angle, are not judged.
    """
    scales = {r.steering_scale: r.name for r in recordings if r.steering_scale is not None}
    if len(scales) > 1:
        raise RecordingError(
            "recordings with different scales of the steering",
            found="; ".join(f"{name}: command 1 is {angle:g} rad"
                            for angle, name in scales.items()),
            expected="one full_scale of [steering] in all maps",
            remedy="import all logs of the car with the same map")
    by_car: dict[str, list[str]] = {}
    for r in recordings:
        if r.car is not None:
            by_car.setdefault(r.car.name, []).append(r.name)
    if len(by_car) > 1:
        found = "; ".join(f"{car}: {', '.join(names[:MAX_NAMED_RECORDINGS])}"
                          + (f" and {len(names) - MAX_NAMED_RECORDINGS} more"
                             if len(names) > MAX_NAMED_RECORDINGS else "")
                          for car, names in by_car.items())
        raise RecordingError(
            f"recordings of {len(by_car)} cars", found=found, expected="recordings of one car",
            remedy="give those of one car; if an import named the wrong car, import it again with "
                   "--car")
