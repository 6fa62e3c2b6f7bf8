"""What a command may become before it reaches a pin: expiry, priority, range, slew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import BadCommand

LONGEST_VALIDITY = 0.5
"""s that one command may hold the car, whatever its sender asks for."""
LONGEST_RAW = 0.2
"""s that raw pulses may hold the car: nobody calibrates at less than 10 Hz."""
RAW_LOW_US, RAW_HIGH_US = 1000.0, 2000.0
"""What an ESC or a servo may be asked for at all: the range of every RC pulse."""
WILD = 10.0
"""rad, and times full throttle: beyond it a controller has diverged or speaks of
degrees and per cent. Below, what is out of range is clipped and said."""


@dataclass(frozen=True, slots=True)
class Command:
    """What one source wants: steering [rad], throttle [-1..1], until [s] of the car's clock.

    ``shortened``: its sender wanted it to hold for longer.
    """

    steering: float
    throttle: float
    until: float
    source: str
    shortened: bool = False


@dataclass(frozen=True, slots=True)
class Pulses:
    """Pulses [us] for a calibration, until [s]; ``throttle``: away from neutral [us].

    ``throttle_us`` 0.0: none at all, what the ESC of a broken wire gets.
    """

    steering_us: float
    throttle_us: float
    throttle: float
    until: float
    shortened: bool = False


def number(name: str, value: object, of: str) -> float:
    """``value`` as a finite float. Raises BadCommand for all that is none.

    True counts as no number: it would be full throttle. So does text, though
    float() would read it.
    """
    if isinstance(value, bool | np.bool_ | str | bytes) or not hasattr(value, "__float__"):
        raise BadCommand(f"{name} of {of} is not a number", found=repr(value)[:80],
                         expected="a finite number; the car is tripped to neutral")
    try:
        known = float(value)
    except (OverflowError, TypeError, ValueError) as error:
        raise BadCommand(f"{name} of {of} is not one finite number", found=str(error),
                         expected="a finite number; the car is tripped to neutral") from error
    if not math.isfinite(known):
        raise BadCommand(f"{name} of {of} is not a number", found=repr(known),
                         expected="a finite number; the car is tripped to neutral")
    return known


def checked(steering: object, throttle: object, valid_for: object, source: str,
            now: float) -> Command:
    """A command of numbers that can be meant, valid for at most 0.5 s. Raises BadCommand."""
    of = f"source {source}"
    angle, part = number("steering", steering, of), number("throttle", throttle, of)
    for name, value, unit in (("steering", angle, "rad"), ("throttle", part, "of full throttle")):
        if abs(value) > WILD:
            raise BadCommand(f"{name} of {of} cannot be meant", found=f"{value:g} {unit}",
                             expected=f"at most {WILD:g} {unit}; degrees or per cent?")
    seconds = validity(valid_for, of)
    return Command(angle, part, number("now", now, of) + seconds, source,
                   seconds < number("valid_for", valid_for, of))


def validity(valid_for: object, of: str, longest: float = LONGEST_VALIDITY) -> float:
    """s for which a command counts, at most ``longest``. Raises BadCommand."""
    seconds = number("valid_for", valid_for, of)
    if seconds <= 0:
        raise BadCommand(f"valid_for of {of} must be positive", found=repr(seconds),
                         expected=f"above 0, at most {longest} s")
    return min(seconds, longest)


def raw_pulses(steering_us: object, throttle_us: object, neutral_us: float, lifted: bool,
               now: float, valid_for: float) -> Pulses:
    """Pulses [us] that servo and ESC can have; ``throttle_us`` None: none for the ESC.

    Without them an ESC may hold its throttle for a second, so that the wheels must be
    ``lifted``; the end of the silence trips as that of a throttle does. Raises BadCommand.
    """
    if throttle_us is None and not lifted:
        raise BadCommand("the ESC may be left without pulses with lifted wheels alone",
                         found="throttle_us=None", expected="a pulse of 1000 to 2000 us",
                         remedy="with car.raw(lifted=True): car.pulses(...)")
    asked = RAW_LOW_US if throttle_us is None else throttle_us
    steering, throttle = number("steering_us", steering_us, "raw"), number("throttle_us", asked,
                                                                           "raw")
    for name, pulse in (("steering_us", steering), ("throttle_us", throttle)):
        if not RAW_LOW_US <= pulse <= RAW_HIGH_US:
            raise BadCommand(f"{name} is not a pulse for this car", found=repr(pulse),
                             expected=f"{RAW_LOW_US:.0f} to {RAW_HIGH_US:.0f} us")
    seconds = validity(valid_for, "raw", LONGEST_RAW)
    return Pulses(steering, 0.0 if throttle_us is None else throttle, throttle - neutral_us,
                  now + seconds, shortened=seconds < valid_for)


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
