"""Failures of devices at given times: ``target:kind[=value]@start[+duration]``.

All targets share the kinds off, stuck, garbage, wrong, slow, delayed and intermittent; buses and
processors have further ones, see ``dart_lab.sim.failure_kinds``. Times are in s of the world. A
failure without a duration is permanent. Of two failures of one device at once, the later counts.

    imu:stuck@3.0s+1s   enc:wrong=0.5@2   i2c:sda@4+0.5   mcu:reset@5   pca:nack=3@6
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from dart_hal.core.errors import UsageError
from dart_lab.sim.failure_kinds import FAILURE_KINDS
from dart_lab.sim.world import World

_DECIMAL = r"\d+(\.\d*)?([eE][+-]?\d+)?"
_SECONDS = r"\d{1,9}(\.\d+)?"  # Finite.
# target:kind, =value, @start with or without "s", + or " " (a + in a URL) and duration.
_PATTERN = re.compile(
    rf"(?P<target>\w+):(?P<kind>\w+)(=(?P<value>{_DECIMAL}))?"
    rf"@(?P<start>{_SECONDS})s?([+ ](?P<duration>{_SECONDS})s?)?$", re.ASCII)


@dataclass(frozen=True, slots=True)
class Failure:
    """One entry; without ``value`` the default of the kind, without ``duration`` inf."""

    target: str
    kind: str
    start: float
    value: float = math.nan
    duration: float = math.inf


def list_failures() -> str:
    """Return all kinds of failures in one line."""
    return ", ".join(sorted(f"{t}:{k}" + (f"={kind.unit}" if kind.unit else "")
                            for (t, k), kind in FAILURE_KINDS.items()))


def parse_failure(text: str) -> Failure:
    """Parse one failure. Raises UsageError that lists all kinds."""
    match = _PATTERN.match(text.strip())
    if match is None:
        raise UsageError(f"{text!r} is not target:kind[=value]@start[+duration]",
                         expected=f"for example imu:stuck@3.0s+1s; there are {list_failures()}")
    found = match.groupdict()
    name = found["target"], found["kind"]
    if name not in FAILURE_KINDS:
        raise UsageError(f"no failure {':'.join(name)}", expected=list_failures())
    kind = FAILURE_KINDS[name]
    # Without a value the default of the kind, which is NaN for a kind without a value.
    value = kind.default if found["value"] is None else float(found["value"])
    if found["value"] is not None and not (kind.unit and kind.low <= value <= kind.high):
        raise UsageError(f"{':'.join(name)} cannot be {found['value']}", found=text,
                         expected=f"{kind.unit} from {kind.low:g} to {kind.high:g}"
                         if kind.unit else "no value")
    return Failure(*name, float(found["start"]), value, float(found["duration"] or "inf"))


def schedule_failures(world: World, failures: list[Failure]) -> None:
    """Schedule the begin and the end of each failure, exact to the tick of 1 ms."""
    for failure in failures:
        _schedule_failure(world, failure)


def _schedule_failure(world: World, failure: Failure) -> None:
    kind = FAILURE_KINDS[failure.target, failure.kind]

    def begin(world: World) -> None:
        end = kind.begin(world, failure.value)
        if failure.duration != math.inf:
            world.schedule(failure.start + failure.duration, end)

    world.schedule(failure.start, begin)


def silent_intervals(failures: list[Failure]) -> list[tuple[float, float]]:
    """Return the intervals [s] in which the line carries nothing, in either direction."""
    return [(f.start, f.start + f.duration) for f in failures
            if (f.target, f.kind) == ("line", "off")]
