"""What a page may say. Everything else is refused, with a sentence, and changes nothing."""

from __future__ import annotations

from math import isfinite

import msgspec

LONGEST = 1024
"""Bytes of a message; a command has 80."""


class Stop(msgspec.Struct, tag="stop", forbid_unknown_fields=True):
    """Stop the car now; anybody may."""


class Take(msgspec.Struct, tag="take", forbid_unknown_fields=True):
    """Become the one who drives."""

    token: str

    def __repr__(self) -> str:  # without the token: it would stand in a log or a traceback
        return "Take(...)"


class Leave(msgspec.Struct, tag="leave", forbid_unknown_fields=True):
    """Let somebody else drive."""


class Arm(msgspec.Struct, tag="arm", forbid_unknown_fields=True):
    """Arm the car, after its own checks."""


class Unlock(msgspec.Struct, tag="unlock", forbid_unknown_fields=True):
    """Leave LOCKED, after three trips in a minute."""


class Drive(msgspec.Struct, tag="drive", forbid_unknown_fields=True):
    """steering (+1: full lock to the left), throttle, both -1..1 and cut there; heard: the newest
    time of the server that the page knows, so that the age of the command shows; unchanged [s]:
    since the page's stick, keys or gamepad last reported anything."""

    steering: float
    throttle: float
    heard: float
    unchanged: float = 0.0


class Release(msgspec.Struct, tag="release", forbid_unknown_fields=True):
    """The stick was let go."""


class Record(msgspec.Struct, tag="record", forbid_unknown_fields=True):
    """Begin or end a recording."""

    on: bool


Message = Stop | Take | Leave | Arm | Unlock | Drive | Release | Record
_decode = msgspec.json.Decoder(Message).decode


class Malformed(ValueError):
    """What came is no message."""


def read(data: str | bytes) -> Message:
    """Raises Malformed."""
    if len(data) > LONGEST:
        raise Malformed(f"a message of {len(data)} bytes, at most {LONGEST} are expected")
    try:
        message: Message = _decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as why:
        raise Malformed(str(why)) from why
    if isinstance(message, Drive) and not all(map(isfinite, msgspec.structs.astuple(message))):
        raise Malformed("a command that is no finite number")
    return message
