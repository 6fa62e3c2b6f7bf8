"""Checks of what a program passes to a car, made before anything is done."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from dart_hal.core.errors import LinkLost, UnknownAttribute, UsageError

if TYPE_CHECKING:
    from dart_hal.recording.run_file import RunFile

# Attributes of a car that are neither method nor property.
CAR_ATTRIBUTES = ("files", "notices", "raise_on_trip", "url")


def check_attribute(name: str) -> None:
    """Raise UnknownAttribute for a public attribute of a car that nothing would read."""
    if not name.startswith("_") and name not in CAR_ATTRIBUTES:
        raise UnknownAttribute(f"car.{name} = ... would do nothing", found=name,
                               expected=", ".join(CAR_ATTRIBUTES),
                               remedy="car.drive(steering=0.1, throttle=0.2)")


def check_url(url: str | None) -> str | None:
    """Return the URL; None is the default car. Raises UsageError for another type or empty text."""
    if url is not None and not isinstance(url, str):
        raise UsageError("the URL of a car is text", found=repr(url),
                         expected="sim://?seed=7, serial:///dev/ttyUSB0?i2c=1, ...",
                         remedy="leave it out for the default car")
    if url is not None and not url.strip():
        raise UsageError("the URL of the car is empty", found=repr(url),
                         expected="sim://?seed=7, serial:///dev/ttyUSB0?i2c=1, ...",
                         remedy="leave it out for the default car")
    return url


def check_record(path: str | Path | RunFile) -> None:
    """Raise UsageError for a folder, and for a name that is not one of an MCAP file."""
    from dart_hal.recording.run_file import RunFile

    path = path.path if isinstance(path, RunFile) else path
    if Path(path).suffix.lower() != ".mcap" or Path(path).is_dir():
        raise UsageError(f"{path}: a recording is an MCAP file",
                         found="a folder" if Path(path).is_dir() else Path(path).name,
                         expected="a name that ends in .mcap",
                         remedy="record to .mcap; afterwards: dart-hal export")


def check_times(**seconds: float) -> None:
    """Raise UsageError for a time [s] of states() that is NaN, below 0, or not a number."""
    for name, value in seconds.items():
        if not isinstance(value, Real) or not value >= 0.0:
            raise UsageError(f"{name} of states() is no time", found=f"{name}={value!r}",
                             expected="seconds, 0 or more")


def check_note(name: str, values: Mapping[str, str]) -> None:
    """Raise UsageError for a note with values that are not text."""
    wrong = [key for key, value in values.items()
             if not isinstance(key, str) or not isinstance(value, str)]
    if wrong:
        raise UsageError(f"note {name!r} holds what is not text", found=repr(values[wrong[0]]),
                         expected="text for text", remedy=f"str(...) around {wrong[0]!r}")


def check_message(name: str, known: Iterable[str]) -> None:
    """Raise UsageError for a message that the protocol does not have."""
    if name not in known:
        from difflib import get_close_matches

        near = get_close_matches(str(name), list(known), n=1)
        raise UsageError(f"the protocol has no message {name!r}", found=repr(name),
                         expected=", ".join(known),
                         remedy=near[0] if near else "docs/reference/wire.md")


def raise_absent(part: str, simulated: str, real: str, url: str) -> NoReturn:
    """Raise UsageError for a car without a lidar or camera, which the program uses."""
    raise UsageError(f"this car has no {part}", found=url,
                     expected=f"a URL or Car.open with {part}=...",
                     remedy=f'sim://?{part}={simulated}, or Car.open({part}="{real}")')


def closed_error(what: str) -> LinkLost:
    """Return the error for using a closed car; ``what``: what was used."""
    return LinkLost("the car is closed", likely=f"{what} outside the with block, or in a forked "
                    "child", remedy="open it again with Car.open()")
