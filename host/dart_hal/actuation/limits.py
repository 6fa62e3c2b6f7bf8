"""What a command may become before it reaches a pin: expiry, priority, range, slew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dart_hal.errors import BadCommand

LONGEST_VALIDITY = 0.5
"""s that one command may hold the car, whatever its sender asks for."""


@dataclass(frozen=True, slots=True)
class Command:
    """What one source wants: steering [rad], throttle [-1..1], until [s] of the car's clock."""

    steering: float
    throttle: float
    until: float
    source: str


def checked(steering: float, throttle: float, valid_for: float, source: str,
            now: float) -> Command:
    """A command of finite numbers, valid for at most 0.5 s. Raises BadCommand."""
    for name, value in (("steering", steering), ("throttle", throttle),
                        ("valid_for", valid_for), ("now", now)):
        if not math.isfinite(value):
            raise BadCommand(f"{name} of source {source} is not a number", found=repr(value),
                             expected="a finite number; the car is tripped to neutral")
    if valid_for <= 0:
        raise BadCommand(f"valid_for of source {source} must be positive", found=repr(valid_for),
                         expected=f"above 0, at most {LONGEST_VALIDITY} s")
    return Command(float(steering), float(throttle), now + min(valid_for, LONGEST_VALIDITY),
                   source)


class Arbiter:
    """The newest command of each source; the source listed first wins."""

    def __init__(self, order: Sequence[str]) -> None:
        self._rank = {source: rank for rank, source in enumerate(order)}
        self._commands: dict[str, Command] = {}
        self._lapsed: Command | None = None

    def put(self, command: Command) -> None:
        """A source speaks; its former command is gone."""
        self._commands.pop(command.source, None)        # the newest stands last
        self._commands[command.source] = command
        self._lapsed = None

    def winner(self, now: float) -> Command | None:
        """The command that counts at ``now``; expired ones are dropped.

        Sources that car.toml does not list rank after all that it does; among
        them the one that spoke last wins.
        """
        for command in list(self._commands.values()):
            if command.until < now:
                self._lapsed = self._commands.pop(command.source)
        standing = list(reversed(self._commands.values()))
        return min(standing, key=self._rank_of, default=None)

    @property
    def lapsed(self) -> Command | None:
        """The last command that ran out, while no newer one has come."""
        return self._lapsed if not self._commands else None

    def clear(self) -> None:
        """Forget every command."""
        self._commands.clear()
        self._lapsed = None

    def _rank_of(self, command: Command) -> int:
        return self._rank.get(command.source, len(self._rank))


def clip(value: float, low: float, high: float) -> float:
    """``value`` within [low, high]."""
    return min(max(value, low), high)


def slew(wanted: float, last: float, rate: float | None, dt: float) -> float:
    """``wanted``, no further than rate x dt from ``last``; rate None = no limit."""
    if rate is None:
        return wanted
    step = rate * max(dt, 0.0)
    return clip(wanted, last - step, last + step)
