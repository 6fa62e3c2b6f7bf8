"""Messages of a page. All others are refused with an error message and have no effect."""

from __future__ import annotations

from math import isfinite

import msgspec

# A command has 80 bytes.
MAX_MESSAGE_BYTES = 1024


class Stop(msgspec.Struct, tag="stop", forbid_unknown_fields=True):
    """Stop the car now; every page may."""


class Take(msgspec.Struct, tag="take", forbid_unknown_fields=True):
    """Become the page that drives."""

    token: str

    # Without the token, which would otherwise appear in logs and tracebacks.
    def __repr__(self) -> str:
        return "Take(...)"


class Leave(msgspec.Struct, tag="leave", forbid_unknown_fields=True):
    """Stop driving, so that another page can drive."""


class Arm(msgspec.Struct, tag="arm", forbid_unknown_fields=True):
    """Arm the car, if its checks pass."""


class Unlock(msgspec.Struct, tag="unlock", forbid_unknown_fields=True):
    """Leave LOCKED, after three trips in a minute."""


class DriveRequest(msgspec.Struct, tag="drive", forbid_unknown_fields=True):
    """A command.

    steering (+1: largest angle to the left), throttle: both -1..1, limited to that. heard: the
    newest server time that the page knows; it gives the age of the command. unchanged [s]: since
    the stick, keys or gamepad of the page last reported a value.
    """

    steering: float
    throttle: float
    heard: float
    unchanged: float = 0.0


class Release(msgspec.Struct, tag="release", forbid_unknown_fields=True):
    """The stick is released: neutral throttle.

    heard: as of DriveRequest. A page repeats the message while it watches the car, which stays
    armed. None: the page is hidden or left, which ends the drive.
    """

    heard: float | None = None


class Record(msgspec.Struct, tag="record", forbid_unknown_fields=True):
    """Begin or end a recording."""

    on: bool


Message = Stop | Take | Leave | Arm | Unlock | DriveRequest | Release | Record
_decode = msgspec.json.Decoder(Message).decode


class MalformedMessage(ValueError):
    """The received data are no valid message."""


def parse_message(data: str | bytes) -> Message:
    """Parse a message of a page. Raises MalformedMessage."""
    if len(data) > MAX_MESSAGE_BYTES:
        raise MalformedMessage(f"a message of {len(data)} bytes, at most {MAX_MESSAGE_BYTES} are "
                               "expected")
    try:
        message: Message = _decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as why:
        raise MalformedMessage(str(why)) from why
    if isinstance(message, DriveRequest | Release) and not all(
            isfinite(value) for value in msgspec.structs.astuple(message) if value is not None):
        raise MalformedMessage("steering, throttle and times must be finite numbers")
    return message
