"""Items of a run other than raw bytes, each with its time."""

from __future__ import annotations

from typing import NamedTuple

from dart_hal.core.types import Applied
from dart_hal.recording.log import Value

# Key in the metadata of a channel: ns since 1970 when the clock of its car was 0.
ZERO = "zero_ns"
# Media types of attachments: facts by name, and the files of the car.
JSON = "application/json"
TOML = "application/toml"
# Attachment by which an imported recording is recognised.
IMPORT_NOTE = "import"


class RecordedCommand(NamedTuple):
    """A command as a source requested it: t [s], steering [rad], throttle [-1..1]."""

    t: float
    steering: float
    throttle: float
    source: str


class I2c(NamedTuple):
    """One bus transaction: t [s], address, bytes written, bytes read."""

    t: float
    address: int
    wrote: bytes
    read: bytes


class Logged(NamedTuple):
    """A value that the program logged at t [s] under a name: a number or an array."""

    t: float
    name: str
    value: Value


class Recorded(NamedTuple):
    """A message for other tools: ns since 1970, its type, its bytes in CDR."""

    topic: str
    kind: str
    ns: int
    data: bytes


class AppliedAt(NamedTuple):
    """The pulses at the pins from t [s] on."""

    t: float
    applied: Applied
