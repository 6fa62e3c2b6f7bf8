"""Checks and limits of a command before it reaches a pin: expiry, priority, range, slew rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import BadCommand

# s for which one command may be valid, whatever its sender requests.
MAX_VALIDITY = 0.5
# s for which raw pulses may be valid: every calibration sends them at 10 Hz or faster.
MAX_RAW_VALIDITY = 0.2
# Range of raw pulses: that of every RC pulse.
RAW_LOW_US = 1000.0
RAW_HIGH_US = 2000.0
# rad, and multiples of full throttle. With a larger value the controller has diverged, or uses
# degrees or per cent: the command is refused. Smaller values out of range are clipped and reported.
MAX_PLAUSIBLE = 10.0


@dataclass(frozen=True, slots=True)
class SourceCommand:
    """Request of one source: steering [rad], throttle [-1..1], until [s] of the car's clock.

    ``shortened``: its sender requested a longer validity; ``reasons``: names of ``Limit`` of the
    controller that made it.
    """

    steering: float
    throttle: float
    until: float
    source: str
    shortened: bool = False
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RawPulses:
    """Pulses [us] for a calibration, until [s]; ``throttle``: distance from neutral [us].

    ``throttle_us`` 0.0: no pulse, as with a broken wire to the ESC.
    """

    steering_us: float
    throttle_us: float
    throttle: float
    until: float
    shortened: bool = False


def to_finite(name: str, value: object, owner: str) -> float:
    """Convert to a finite float; name, owner: for the message.

    Raises BadCommand for NaN, infinity, bool (True would be full throttle), and text, although
    float() would read it.
    """
    if isinstance(value, bool | np.bool_ | str | bytes) or not hasattr(value, "__float__"):
        raise BadCommand(f"{name} of {owner} is not a number", found=repr(value)[:80],
                         expected="a finite number; the car is tripped to neutral")
    try:
        number = float(value)
    except (OverflowError, TypeError, ValueError) as error:
        raise BadCommand(f"{name} of {owner} is not one finite number", found=str(error),
                         expected="a finite number; the car is tripped to neutral") from error
    if not math.isfinite(number):
        raise BadCommand(f"{name} of {owner} is not a number", found=repr(number),
                         expected="a finite number; the car is tripped to neutral")
    return number


def parse_command(steering: object, throttle: object, valid_for: object, source: str,
                  now: float, reasons: tuple[str, ...] = ()) -> SourceCommand:
    """Make a command of plausible numbers, valid for at most 0.5 s. Raises BadCommand."""
    owner = f"source {source}"
    angle = to_finite("steering", steering, owner)
    part = to_finite("throttle", throttle, owner)
    for name, value, expected, likely in (
            ("steering", angle, "an angle in rad", "degrees"),
            ("throttle", part, "-1 to 1", "per cent")):
        if abs(value) > MAX_PLAUSIBLE:
            raise BadCommand(f"{name} of {owner} is implausible", found=f"{value:g}",
                             expected=expected, likely=likely)
    seconds = limit_validity(valid_for, owner)
    return SourceCommand(angle, part, to_finite("now", now, owner) + seconds, source,
                         seconds < to_finite("valid_for", valid_for, owner), reasons)


def limit_validity(valid_for: object, owner: str, maximum: float = MAX_VALIDITY) -> float:
    """Return the validity [s] of a command, at most ``maximum``. Raises BadCommand."""
    seconds = to_finite("valid_for", valid_for, owner)
    if seconds <= 0:
        raise BadCommand(f"valid_for of {owner} must be positive", found=repr(seconds),
                         expected=f"above 0, at most {maximum} s")
    return min(seconds, maximum)


def parse_raw_pulses(steering_us: object, throttle_us: object, neutral_us: float, lifted: bool,
                     now: float, valid_for: float) -> RawPulses:
    """Make raw pulses of numbers in the range of RC pulses [us]. Raises BadCommand.

    ``throttle_us`` None: no pulse for the ESC. An ESC may then keep its throttle for a second, so
    the wheels must be ``lifted``. Its expiry trips as that of a throttle pulse does.
    """
    if throttle_us is None and not lifted:
        raise BadCommand("the ESC may be without pulses only with lifted wheels",
                         found="throttle_us=None", expected="a pulse of 1000 to 2000 us",
                         remedy="with car.raw(lifted=True): car.pulses(...)")
    steering = to_finite("steering_us", steering_us, "raw")
    throttle = to_finite("throttle_us", RAW_LOW_US if throttle_us is None else throttle_us, "raw")
    for name, pulse in (("steering_us", steering), ("throttle_us", throttle)):
        if not RAW_LOW_US <= pulse <= RAW_HIGH_US:
            raise BadCommand(f"{name} is not a pulse for this car", found=repr(pulse),
                             expected=f"{RAW_LOW_US:.0f} to {RAW_HIGH_US:.0f} us")
    seconds = limit_validity(valid_for, "raw", MAX_RAW_VALIDITY)
    return RawPulses(steering, 0.0 if throttle_us is None else throttle, throttle - neutral_us,
                     now + seconds, shortened=seconds < valid_for)


class Arbiter:
    """The newest command of each source; the source listed first wins."""

    def __init__(self, order: Sequence[str]) -> None:
        self._rank = {source: rank for rank, source in enumerate(order)}
        self._commands: dict[str, SourceCommand] = {}
        self._expired: SourceCommand | None = None

    def put(self, command: SourceCommand) -> None:
        """Store a command in place of the former one of its source."""
        self._commands.pop(command.source, None)        # the newest command is the last entry
        self._commands[command.source] = command
        self._expired = None

    def winner(self, now: float) -> SourceCommand | None:
        """Return the valid command of highest priority at ``now``, and drop expired ones.

        Sources that car.toml does not list rank last; among them the newest command wins.
        """
        for command in list(self._commands.values()):
            if command.until < now:
                self._expired = self._commands.pop(command.source)
        newest_first = list(reversed(self._commands.values()))
        return min(newest_first, key=self._rank_of, default=None)

    @property
    def last_expired(self) -> SourceCommand | None:
        """The last command that expired, while no other one is valid; else None."""
        return self._expired if not self._commands else None

    def clear(self) -> None:
        """Drop every command."""
        self._commands.clear()
        self._expired = None

    def _rank_of(self, command: SourceCommand) -> int:
        return self._rank.get(command.source, len(self._rank))


def clip(value: float, low: float, high: float) -> float:
    """Clip ``value`` to [low, high]."""
    return min(max(value, low), high)


def limit_slew(target: float, last: float, rate: float | None, dt: float) -> float:
    """Limit ``target`` to a change of rate x dt from ``last``; rate None = no limit."""
    if rate is None:
        return target
    step = rate * max(dt, 0.0)
    return clip(target, last - step, last + step)
