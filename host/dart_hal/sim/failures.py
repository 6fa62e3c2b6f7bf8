"""Faults of devices on a timetable: ``target:kind[=value]@start[+duration]``.

One vocabulary for all targets (off, stuck, garbage, and what is special to a
bus or a processor); times in s of the world. A failure without a duration
stays.

    imu:stuck@3.0s+1s   enc:off@2   i2c:sda@4+0.5   mcu:reset@5   pca:nack=3@6
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dart_hal.errors import UsageError
from dart_hal.sim.world import World

_FORM = re.compile(
    r"(?P<target>\w+):(?P<kind>\w+)(=(?P<value>[\d.eE-]+))?"
    r"@(?P<start>\d+(\.\d+)?)s?([+ ](?P<duration>\d+(\.\d+)?)s?)?$")

Action = Callable[[World, float], None]


@dataclass(frozen=True, slots=True)
class Failure:
    """One entry; ``value`` is nan and ``duration`` inf when not given."""

    target: str
    kind: str
    start: float
    value: float = float("nan")
    duration: float = float("inf")


def _call(name: str, *args: Any) -> Action:
    """An action on the Nano, refused by name where that Nano has no such thing."""

    def act(world: World, value: float) -> None:
        method = getattr(world.nano, name, None)
        if method is None:
            raise UsageError(f"{type(world.nano).__name__} cannot do {name}{args}",
                             remedy="use nano=avr")
        method(*args)

    return act


def _enc(ring: int, on: bool) -> Action:
    def act(world: World, value: float) -> None:
        rings = (world.car.ring_a, world.car.ring_b)
        world.nano.set_ring(ring, rings[ring].edges if on else ())

    return act


def _pca_nack(world: World, value: float) -> None:
    world.bus.nack = 10**9 if value != value else int(value)


def _pca_fine(world: World, value: float) -> None:
    world.bus.nack = 0


def _pca_brown_out(world: World, value: float) -> None:
    world.pca.brown_out(world.t)


def _bus(line: str) -> Action:
    def act(world: World, value: float) -> None:
        world.bus.stuck = line

    return act


def _nothing(world: World, value: float) -> None:
    """A failure that is over as soon as it has happened."""


ACTIONS: dict[tuple[str, str], tuple[Action, Action]] = {
    **{("imu", k): (_call("set_imu_fault", k), _call("set_imu_fault", "ok"))
       for k in ("off", "stuck", "garbage")},
    **{("i2c", k): (_call("set_i2c", k), _call("set_i2c", "ok"))
       for k in ("nack", "sda", "scl", "dead")},
    ("enc", "off"): (_enc(0, False), _enc(0, True)),
    ("enc2", "off"): (_enc(1, False), _enc(1, True)),
    ("mcu", "reset"): (_call("reset", "external"), _nothing),
    ("mcu", "brownout"): (_call("reset", "brownout"), _nothing),
    ("mcu", "watchdog"): (_call("reset", "watchdog"), _nothing),
    ("mcu", "hang"): (_call("hang", True), _call("hang", False)),
    ("pca", "nack"): (_pca_nack, _pca_fine),
    ("pca", "brownout"): (_pca_brown_out, _nothing),
    ("pca", "sda"): (_bus("sda"), _bus("")),
    ("pca", "scl"): (_bus("scl"), _bus("")),
    ("line", "off"): (_nothing, _nothing),      # the link's part: see silences()
}
"""What begins and ends each failure. i2c is the Nano's bus, pca the board's."""


def parse(text: str) -> Failure:
    """One failure. Raises UsageError that lists what exists."""
    match = _FORM.match(text.strip())
    known = ", ".join(sorted(f"{t}:{k}" for t, k in ACTIONS))
    if match is None:
        raise UsageError(f"{text!r} is not target:kind[=value]@start[+duration]",
                         expected=f"for example imu:stuck@3.0s+1s; there are {known}")
    found = match.groupdict()
    if (found["target"], found["kind"]) not in ACTIONS:
        raise UsageError(f"no failure {found['target']}:{found['kind']}", expected=known)
    return Failure(found["target"], found["kind"], float(found["start"]),
                   float(found["value"] or "nan"), float(found["duration"] or "inf"))


def schedule(world: World, failures: list[Failure]) -> None:
    """Let each failure begin and end in the world at its time (to the tick of 1 ms)."""
    for failure in failures:
        begin, end = ACTIONS[failure.target, failure.kind]
        world.at(failure.start, _bound(begin, failure.value))
        if failure.duration != float("inf"):
            world.at(failure.start + failure.duration, _bound(end, failure.value))


def silences(failures: list[Failure]) -> list[tuple[float, float]]:
    """Intervals [s] in which the line carries nothing, either way."""
    return [(f.start, f.start + f.duration) for f in failures if f.target == "line"]


def _bound(act: Action, value: float) -> Callable[[World], None]:
    return lambda world: act(world, value)
