"""Values that a program logs: valid names and values of their channels in a recording."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TypeAlias

import numpy as np

from dart_hal.core.errors import LogError
from dart_hal.core.types import FloatArray

# Start of the topics, so that a name of a user is never that of another channel.
PREFIX = "/log/"
Value: TypeAlias = "float | FloatArray"

_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", re.ASCII)  # what ROS 2 allows in a topic


class LogNames:
    """Names that a program has logged, each with its kind: number or array."""

    def __init__(self) -> None:
        self._arrays: dict[str, bool] = {}

    def take(self, name: str, value: object) -> dict[str, Value]:
        """Convert ``value`` into channels: a number, an array, or one ``name/key`` per dict entry.

        NaN and inf are values, True is 1. Raises LogError and then stores no name.
        """
        found = dict(_flatten(name, value))
        for channel, numbers in found.items():
            is_array = isinstance(numbers, np.ndarray)
            if self._arrays.get(channel, is_array) != is_array:
                kinds = ("an array", "a number") if is_array else ("a number", "an array")
                raise LogError(f"{channel!r} was logged as {kinds[1]} before", found=kinds[0],
                               expected=kinds[1], remedy="give each of them a name of its own")
        self._arrays |= {c: isinstance(v, np.ndarray) for c, v in found.items()}
        return found


def _flatten(name: object, value: object) -> Iterator[tuple[str, Value]]:
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise LogError(f"{name!r} is no name of a channel", found=repr(name)[:80],
                       expected="letters, digits and _, parts joined by /: mpc/cost")
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flatten(f"{name}/{key}" if isinstance(key, str) else key, inner)
    else:
        yield name, _to_numbers(name, value)


def _to_numbers(name: str, value: object) -> Value:
    if isinstance(value, np.ma.MaskedArray):
        raise LogError(f"{name!r} is a masked array", found=repr(value)[:80],
                       expected="numbers; value.filled(nan) marks missing ones")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise LogError(f"{name!r} cannot be made an array", found=str(error)) from error
    if array.dtype.kind not in "biuf":
        raise LogError(f"{name!r} is not made of numbers", found=repr(value)[:80])
    return array.astype(np.float64) if array.ndim else float(array)
