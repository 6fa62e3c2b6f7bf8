"""Key of a room: a secret shared by its members, and the signature of a frame.

A signature is the first 16 bytes of HMAC-SHA-256 (RFC 2104) over the whole frame, so over kind,
session, number, time and body. It proves that a member with the key has made this frame at some
time. ``dart_hal.fleet.peers`` detects recordings of frames.
"""

from __future__ import annotations

import hmac
import os
from dataclasses import dataclass, field
from pathlib import Path

from dart_hal.core.errors import UsageError
from dart_hal.fleet.messages import SIGNATURE_BYTES

# Environment variable: the key itself, or the path of its file (with a first /, ~ or .).
KEY_VARIABLE = "DART_ROOM_KEY"
# Shorter keys can be guessed from one recorded frame.
MIN_KEY_BYTES = 16
# A larger file is not a key but another file, given by mistake.
MAX_KEY_BYTES = 4096
KEY_REMEDY = "(umask 077; openssl rand -hex 32 > room.key), then copy room.key to every member"
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class RoomKey:
    """secret: at least ``MIN_KEY_BYTES``. It appears in no text of the object."""

    secret: bytes = field(repr=False)

    def __post_init__(self) -> None:
        if len(self.secret) < MIN_KEY_BYTES:
            raise UsageError("the key of a room is too short", found=f"{len(self.secret)} bytes",
                             expected=f"at least {MIN_KEY_BYTES} bytes that cannot be guessed",
                             remedy=KEY_REMEDY)

    def signature(self, frame: bytes) -> bytes:
        """Compute the signature of a frame without one."""
        return hmac.digest(self.secret, frame, "sha256")[:SIGNATURE_BYTES]

    def verify(self, data: bytes) -> bool:
        """Whether the end of a datagram is the signature of what precedes it."""
        end = len(data) - SIGNATURE_BYTES
        return end > 0 and hmac.compare_digest(data[end:], self.signature(data[:end]))


def read_key(path: str | Path) -> RoomKey:
    """Read the key in a file, without blanks and line ends around it. Raises UsageError."""
    try:
        with Path(path).expanduser().open("rb") as file:
            content = file.read(MAX_KEY_BYTES + 1)
    except (OSError, ValueError, RuntimeError) as why:
        raise UsageError(f"the key of the room cannot be read: {path}", found=str(why),
                         expected="a file that this user may read", remedy=KEY_REMEDY) from why
    if len(content) > MAX_KEY_BYTES:
        raise UsageError(f"{path} is no key of a room", found=f"more than {MAX_KEY_BYTES} bytes",
                         expected="one line of 64 hexadecimal digits", remedy=KEY_REMEDY)
    try:
        return RoomKey(content.removeprefix(_BYTE_ORDER_MARK).strip())
    except UsageError as why:
        raise UsageError(f"{path}: {why.what}", found=why.found, expected=why.expected,
                         remedy=why.remedy) from why


def find_key(given: RoomKey | str | Path | None = None) -> RoomKey | None:
    """Return the given key, else that of $DART_ROOM_KEY, else None.

    given: a key, or the path of its file. Raises UsageError, also for a variable that is set and
    empty: a room that requires a key must not be joined without one.
    """
    if isinstance(given, RoomKey):
        return given
    if given is not None:
        return read_key(given)
    text = os.environ.get(KEY_VARIABLE)
    if text is None:
        return None
    if text.startswith(("/", "~", ".")):
        return read_key(text)
    try:
        return RoomKey(os.fsencode(text).strip())
    except UsageError as why:
        raise UsageError(f"${KEY_VARIABLE}: {why.what}", found=why.found,
                         expected=f"{why.expected}, or the path of a file with a first / ~ or .",
                         remedy=why.remedy) from why
