"""The MCAP file below a run, or below the runs of several cars on one time base.

In a file of several cars the channels and attachments of each begin with its name:
``red/rx``, ``/red/odom``; the attachment ``fleet`` lists the cars. Letters that ROS does not
have in topics become _. Stamps are those of the first car's clock; ``shift_ns`` is what was added
to a car's own, in whole ns, so that a replay sees the very stamps of the run.
"""

from __future__ import annotations

import json
import re
import threading
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from dart_hal.errors import RecordingError, UsageError
from dart_hal.process.forks import private
from dart_hal.recording.mcap_records import JSON, McapFile
from dart_hal.recording.schemas import definition

LIBRARY = "dart-hal recording 4"
"""Fixed: a version of a library here would change the bytes of a run."""
FLUSH = 0.05
"""s of recording time in a chunk: a kill loses at most that."""
CARS = "fleet"
"""Name of the attachment that lists the cars of a file."""


def mcap_writer(file: BinaryIO) -> Writer:
    """mcap's writer as runs use it: nothing compressed, a checksum on everything."""
    writer = Writer(file, compression=CompressionType.NONE, enable_data_crcs=True)
    writer.start(profile="ros2", library=LIBRARY)
    return writer


class RunFile:
    """A file that one run writes, or several (``enter``). Closed when the last one leaves."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.lock = threading.RLock()  # re-entrant: a signal may close in the middle of a write
        self._file = private(self.path.open("wb", buffering=1 << 16))
        self._writer = mcap_writer(self._file)
        self._schemas: dict[str, int] = {}
        self._cars: dict[str, str] = {}
        self._zero: float | None = None
        self._users = 0
        self._flushed: int | None = None
        self.closed = False

    def enter(self, name: str, shift_ns: int) -> str:
        """A car of a fleet begins its run: what its channels begin with. Raises UsageError."""
        with self.lock:
            number, unique = 1, name
            while unique in self._cars:
                number += 1
                unique = f"{name}-{number}"
            prefix = re.sub(r"\W", "_", unique, flags=re.ASCII) + "/"
            if prefix in {json.loads(text)["prefix"] for text in self._cars.values()}:
                raise UsageError(f"{self.path}: two cars would write to {prefix}", found=unique,
                                 expected="names that differ by letters and digits")
            self._cars[unique] = json.dumps({"prefix": prefix, "shift_ns": shift_ns})
            self.attach(CARS, JSON, json.dumps(self._cars), 0)
            return prefix

    def shift_of(self, zero: float | None) -> float:
        """s from a car's clock to that of the first car; zero: when the car's clock was 0, on the
        computer's. None: a car in virtual time, whose world begins at 0 like all of them."""
        if zero is None:
            return 0.0
        self._zero = zero if self._zero is None else self._zero
        return max(zero - self._zero, 0.0)

    def begin(self) -> None:
        """One run more."""
        self._users += 1

    def schema(self, kind: str) -> int:
        """The number of a message type, registered at its first use."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind))
        return self._schemas[kind]

    def channel(self, topic: str, kind: str) -> int:
        """A new channel."""
        return int(self._writer.register_channel(topic, "cdr", self.schema(kind)))

    def attach(self, name: str, kind: str, text: str, ns: int) -> None:
        """A file or facts; the lock is held or taken."""
        with self.lock:
            self._writer.add_attachment(ns, ns, name, kind, text.encode())

    def add(self, channel: int, ns: int, rest: int, data: bytes) -> None:
        """A message at ns; the lock is held."""
        self._writer.add_message(channel, ns, data, ns, rest)
        if self._flushed is None or abs(ns - self._flushed) >= FLUSH * 1e9:
            self.flush()  # stamps of host and car are not quite in order
            self._flushed = ns

    def flush(self) -> None:
        """End the chunk."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def leave(self) -> None:
        """One run less; the last one writes the index."""
        with self.lock:
            self._users -= 1
            if self._users <= 0:
                self.close()

    def close(self) -> None:
        """Write the index; idempotent."""
        with self.lock:
            if not self.closed:
                self.closed = True
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.close()


def named(prefix: str, topic: str) -> str:
    """The topic of a car whose channels begin with ``prefix``."""
    return f"/{prefix}{topic[1:]}" if topic.startswith("/") else prefix + topic


def split_car(path: Path | str) -> tuple[Path, str | None]:
    """``fleet.mcap?car=red`` as file and car; the file itself may be called so."""
    text, mark, car = str(path).rpartition("?car=")
    return (Path(text), car) if mark and not Path(path).exists() else (Path(path), None)


def cars_in(found: McapFile) -> tuple[str, ...]:
    """Names of the cars of a file of several; () for one of one car."""
    return tuple(found.metadata.get(CARS, ()))


def of_car(found: McapFile, car: str | None) -> McapFile:
    """The part of one car, as if it were a file of its own. Raises RecordingError."""
    cars = found.metadata.get(CARS, {})
    if not cars and car is None:
        return found
    if car not in cars:
        example = f"{found.path}?car={next(iter(cars), 'NAME')}"
        raise RecordingError(
            f"{found.path}: holds {', '.join(cars)}" if cars else f"{found.path}: holds one car",
            found="no car named" if car is None else car, read=str(found.path),
            expected="one of them" if cars else "no ?car=",
            remedy=f"replay://{example}, RunReader('{example}')" if cars else str(found.path))
    told = json.loads(cars[car])
    prefix, shift = str(told["prefix"]), int(told["shift_ns"])
    topics = {n: own for n, topic in found.topics.items() if (own := _own(prefix, topic))}
    types = {own: kind for topic, kind in found.types.items() if (own := _own(prefix, topic))}
    facts = {name.removeprefix(prefix): values for name, values in found.metadata.items()
             if name.startswith(prefix)}
    files = {name.removeprefix(prefix): text
             for name, text in found.metadata.get("files", {}).items() if name.startswith(prefix)}
    return replace(found, topics=topics, types=types, shift=shift,
                   metadata={**facts, "files": files} if files else facts)


def _own(prefix: str, topic: str) -> str:
    if topic.startswith("/" + prefix):
        return "/" + topic[1 + len(prefix):]
    return topic[len(prefix):] if topic.startswith(prefix) else ""
