"""Failures of devices on a timetable: ``target:kind[=value]@start[+duration]``.

One vocabulary for all targets (off, stuck, garbage, wrong, slow, delayed,
intermittent, and what is special to a bus or a processor, see
``dart_lab.sim.failure_kinds``); times in s of the world. A failure without a
duration stays. Two failures of one device at once: the later one counts.

    imu:stuck@3.0s+1s   enc:wrong=0.5@2   i2c:sda@4+0.5   mcu:reset@5   pca:nack=3@6
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from dart_hal.core.errors import UsageError
from dart_lab.sim.failure_kinds import KINDS
from dart_lab.sim.world import World

_NUMBER = r"\d+(\.\d*)?([eE][+-]?\d+)?"
_TIME = r"\d{1,9}(\.\d+)?"  # s, finite
_FORM = re.compile(
    rf"(?P<target>\w+):(?P<kind>\w+)(=(?P<value>{_NUMBER}))?"
    rf"@(?P<start>{_TIME})s?([+ ](?P<duration>{_TIME})s?)?$", re.ASCII)


@dataclass(frozen=True, slots=True)
class Failure:
    """One entry; ``value`` is the kind's own and ``duration`` inf when not given."""

    target: str
    kind: str
    start: float
    value: float = math.nan
    duration: float = math.inf


def known() -> str:
    """Every failure there is, in one line."""
    return ", ".join(sorted(f"{t}:{k}" + (f"={kind.unit}" if kind.unit else "")
                            for (t, k), kind in KINDS.items()))


def parse(text: str) -> Failure:
    """One failure. Raises UsageError that lists what exists."""
    match = _FORM.match(text.strip())
    if match is None:
        raise UsageError(f"{text!r} is not target:kind[=value]@start[+duration]",
                         expected=f"for example imu:stuck@3.0s+1s; there are {known()}")
    found = match.groupdict()
    name = found["target"], found["kind"]
    if name not in KINDS:
        raise UsageError(f"no failure {':'.join(name)}", expected=known())
    kind = KINDS[name]
    value = kind.default if found["value"] is None else float(found["value"])
    if found["value"] is not None and not (kind.unit and kind.low <= value <= kind.high):
        raise UsageError(f"{':'.join(name)} cannot be {found['value']}", found=text,
                         expected=f"{kind.unit} from {kind.low:g} to {kind.high:g}"
                         if kind.unit else "no value")
    return Failure(*name, float(found["start"]), value, float(found["duration"] or "inf"))


def schedule(world: World, failures: list[Failure]) -> None:
    """Let each failure begin and end in the world at its time (to the tick of 1 ms)."""
    for failure in failures:
        _plan(world, failure)


def _plan(world: World, failure: Failure) -> None:
    kind = KINDS[failure.target, failure.kind]

    def begin(world: World) -> None:
        end = kind.begin(world, failure.value)
        if failure.duration != math.inf:
            world.at(failure.start + failure.duration, end)

    world.at(failure.start, begin)


def silences(failures: list[Failure]) -> list[tuple[float, float]]:
    """Intervals [s] in which the line carries nothing, either way."""
    return [(f.start, f.start + f.duration) for f in failures
            if (f.target, f.kind) == ("line", "off")]
