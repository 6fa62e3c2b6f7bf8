"""Messages between the members of a room, defined once.

A datagram is one frame, little-endian:

    "DF" | version u8 | kind u8 | boot u32 | seq u32 | sent u64 [us] | body | CRC-32

``boot``: random number of the session; ``seq``: counts its frames of every kind; ``sent``: time
of the clock of the transport, by which transits are compared; body: the fields of the kind in
their order.
As on the wire of the Nano the CRC begins with the hash of the definition, so that two programs
with different definitions cannot misread each other. A changed kind gets a new id.

Version 1 is a frame of a room without a key. Version 2 is the same frame followed by its
signature (``dart_hal.fleet.key``); a member of a room with a key accepts no other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from struct import Struct
from zlib import crc32

MAGIC = b"DF"
VERSION = 1
SIGNED_VERSION = 2
# Bytes of a signature: a forger guesses it with probability 2**-128.
SIGNATURE_BYTES = 16
HEAD = Struct("<2sBBIIQ")
# One Ethernet frame of 1500 bytes minus the headers of IP, UDP and zenoh.
MAX_FRAME_BYTES = 1400
# Bytes of a name in UTF-8.
MAX_NAME_BYTES = 32
# Bytes of a longer text.
MAX_TEXT_BYTES = 200
# Rows of a field, such as points of a plan: 3.2 s in steps of 50 ms.
MAX_ROWS = 64
FORMATS = {"u8": "B", "u32": "I", "f32": "f", "f64": "d"}
# Types with several rows of ``count`` numbers each.
ROW_FORMATS = {"rows": "f", "pairs": "I"}


@dataclass(frozen=True)
class Field:
    """One field of a message.

    type: of ``FORMATS``, or text (u8 length, UTF-8, at most ``count`` bytes), or bytes (u8 length,
    at most ``count``), or rows (u8 number of rows, at most ``MAX_ROWS``, of ``count`` f32), or
    pairs (the same of u32). low, high: allowed range.
    """

    name: str
    type: str
    doc: str
    count: int = 1
    low: float = -inf
    high: float = inf

    @property
    def text(self) -> str:
        """Canonical text that is hashed."""
        return f"{self.name}:{self.type}:{self.count}"

    @cached_property
    def struct(self) -> Struct:
        """Format of the field; of one row for ``rows`` and ``pairs``."""
        letter = FORMATS.get(self.type) or ROW_FORMATS.get(self.type, "f")
        return Struct(f"<{self.count}{letter}")


@dataclass(frozen=True)
class Kind:
    """One kind of message; its values are tuples in the order of ``fields``."""

    name: str
    id: int
    doc: str
    fields: tuple[Field, ...] = field(repr=False)

    @cached_property
    def seed(self) -> int:
        """Start value of the CRC: hash of version and definition."""
        body = "; ".join(f.text for f in self.fields)
        return crc32(f"{VERSION} {self.name} {self.id}; {body}".encode("ascii"))


def _kind(name: str, id: int, doc: str, *fields: Field) -> Kind:
    return Kind(name, id, doc, fields)


_F = Field
# m: largest coordinate.
MAX_ROOM_SIZE = 1e5
_NAME = _F("name", "text", "of the sending car", count=MAX_NAME_BYTES)
_AGE = _F("age", "f32", "s from the described moment to ``sent``, by the sender's clock",
          low=0.0, high=1e6)

POSE = _kind(
    "POSE", 1, "where the rear axle is and how it moves, 20 Hz", _NAME, _AGE,
    _F("frame", "text", "of the pose: the room's, or ``start``", count=MAX_NAME_BYTES),
    _F("x", "f64", "m", low=-MAX_ROOM_SIZE, high=MAX_ROOM_SIZE),
    _F("y", "f64", "m", low=-MAX_ROOM_SIZE, high=MAX_ROOM_SIZE),
    _F("yaw", "f64", "rad, not wrapped", low=-1e6, high=1e6),
    _F("var", "f32", "variances of x, y, yaw", count=3, low=0.0, high=1e12),
    _F("cov", "f32", "covariances xy, x yaw, y yaw", count=3, low=-1e12, high=1e12),
    _F("speed", "f32", "m/s, signed", low=-100.0, high=100.0),
    _F("yaw_rate", "f32", "rad/s", low=-100.0, high=100.0),
    _F("tracking", "u8", "TRACKING, DEAD_RECKONING, JUMPED, LOST", high=3),
)
PLAN = _kind(
    "PLAN", 2, "where the car means to be, 20 Hz while it has a plan", _NAME, _AGE,
    _F("frame", "text", "of the points", count=MAX_NAME_BYTES),
    _F("step", "f32", "s from point to point; the first is at the plan's time", low=2.0**-10,
       high=10.0),
    _F("points", "rows", "x, y [m], yaw [rad], speed [m/s]", count=4, low=-MAX_ROOM_SIZE,
       high=MAX_ROOM_SIZE),
)
HEALTH = _kind(
    "HEALTH", 3, "how the car is, 20 Hz", _NAME,
    _F("mode", "text", "of its supervisor: ARMED, TRIPPED, ...", count=MAX_NAME_BYTES),
    _F("lost", "u32", "frames lost since it was opened"),
    _F("doubts", "text", "names of what is doubted, by spaces", count=MAX_TEXT_BYTES),
    _F("held", "text", "what keeps it from driving, empty = nothing", count=MAX_TEXT_BYTES),
)
STOP = _kind(
    "STOP", 4, "every car: throttle neutral, disarmed; repeated until each has answered", _NAME,
    _F("number", "u32", "of this stop, drawn at random by its sender; not 0", low=1),
    _F("why", "text", "reason, for the log", count=MAX_TEXT_BYTES),
)
STOPPED = _kind(
    "STOPPED", 5, "the answer to each STOP that is heard", _NAME,
    _F("number", "u32", "of the stop", low=1),
)
BEAT = _kind("BEAT", 6, "a station watches the room, 20 Hz. It counts from the time of the "
             "receiver's own frame that its sender has echoed last (HEARD)", _NAME)
# Bytes of a coordination.
MAX_PAYLOAD_BYTES = 255
COORDINATION = _kind(
    "COORDINATION", 7, "payload of a control law that several cars share, at its own times", _NAME,
    _F("payload", "bytes", "the law's own", count=MAX_PAYLOAD_BYTES),
)

HEARD = _kind(
    "HEARD", 8, "the newest frame received from each other member, 20 Hz. A member that finds its "
    "own recent frame in it knows that the sender is alive now: a recording cannot contain it",
    _NAME,
    _F("echoes", "pairs", "boot and seq of the newest frame of each member", count=2),
)

BATTERY = _kind(
    "BATTERY", 9, "voltage of the battery, 20 Hz while a car has a reading", _NAME,
    _F("voltage", "f32", "V", low=0.0, high=100.0),
)

KINDS = (POSE, PLAN, HEALTH, STOP, STOPPED, BEAT, COORDINATION, HEARD, BATTERY)
BY_ID = {kind.id: kind for kind in KINDS}
