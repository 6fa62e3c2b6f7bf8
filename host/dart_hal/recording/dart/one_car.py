"""Refuse recordings of several cars where they would be pooled as those of one."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.core.errors import RecordingError

from .model import Recording

# Recordings that are named in the message for each car.
MAX_NAMED_RECORDINGS = 3


def refuse_several_cars(recordings: Sequence[Recording]) -> None:
    """Raise RecordingError if the recordings state different cars.

    A fit to two cars finds the mean of both, and a diagnosis a cause that neither has. Recordings
    without a car file are not judged.
    """
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
