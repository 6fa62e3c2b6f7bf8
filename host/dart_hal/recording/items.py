"""Items of a run other than raw bytes, each with its time."""

from __future__ import annotations

from typing import NamedTuple

from dart_hal.core.types import Applied
from dart_hal.recording.log import Value


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
