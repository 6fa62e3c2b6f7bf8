"""Refuse recordings of several cars where they would be pooled as those of one."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.core.errors import RecordingError

from .model import Recording
from .response import RESPONSES, CarDifference, compare_responses, measure_response

# Recordings that are named in the message for each car.
MAX_NAMED_RECORDINGS = 3


def refuse_several_cars(recordings: Sequence[Recording]) -> None:
    """Raise RecordingError if the recordings state different cars, or scales of the steering.

    A fit to two cars finds the mean of both, and a diagnosis a cause that neither has. The same
    holds for logs whose maps state different angles of the command 1. Unless all recordings state
    one car, those that respond to the commands as two cars are refused, too.
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
        raise RecordingError(
            f"recordings of {len(by_car)} cars",
            found="; ".join(f"{car}: {_shorten(names)}" for car, names in by_car.items()),
            expected="recordings of one car",
            remedy="give those of one car; if an import named the wrong car, import it again with "
                   "--car")
    if _state_one_car(recordings):
        return
    difference = find_car_difference(recordings)
    if difference is not None:
        raise RecordingError(
            "recordings of two cars, or of one that was changed in between",
            found=describe_difference(difference), expected="recordings of one car",
            read=_shorten([*difference.first, *difference.second]),
            remedy="give those of one group; if all are of one car, dart-hal data import --car "
                   "NAME states it")


def caution_several_cars(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return a caution if recordings of one stated car respond as those of two, else nothing."""
    difference = find_car_difference(recordings) if _state_one_car(recordings) else None
    return () if difference is None else (
        "the recordings look like those of two cars, or of one that was changed in between: "
        f"{describe_difference(difference)}; fit each group by itself",)


def find_car_difference(recordings: Sequence[Recording]) -> CarDifference | None:
    """Find the most significant difference that recordings of one car do not have, or None."""
    if len(recordings) < 2:
        return None
    return compare_responses([measure_response(r) for r in recordings])


def describe_difference(difference: CarDifference) -> str:
    """Return a difference in words, with the recordings of both groups."""
    factor = 1.0 + difference.size
    if factor > 1.0 and difference.error > factor:
        return (f"{RESPONSES[difference.kind]} is nearly 0 in {_shorten(difference.first)}, unlike "
                f"in {_shorten(difference.second)}")
    return (f"{RESPONSES[difference.kind]} is {factor:.2f} +- {difference.error:.2f} "
            f"times as large in {_shorten(difference.second)} as in {_shorten(difference.first)}")


def _state_one_car(recordings: Sequence[Recording]) -> bool:
    """Return whether all recordings state a car, and the same one."""
    return len({None if r.car is None else r.car.name for r in recordings}) == 1 and all(
        r.car is not None for r in recordings)


def _shorten(names: Sequence[str]) -> str:
    """Return the first names, and the number of the others."""
    more = len(names) - MAX_NAMED_RECORDINGS
    return ", ".join(names[:MAX_NAMED_RECORDINGS]) + (f" and {more} more" if more > 0 else "")
