"""The MCAP file of a run, or of the runs of several cars on one time base.

Stamps count from 1970. The metadata of each channel have the zero of its car's clock, ``zero_ns``
in whole ns, so that a replay has exactly the stamps of the run. They are in the first chunk and
again in the index. Virtual time has no calendar: its zero is 1970, and the same run gives the same
bytes.

In a file of several cars the channels and attachments of each car begin with its name:
``/red/rx``, ``/red/odom``; the attachment ``fleet`` lists the cars. Letters that ROS does not
allow in topics become _.
"""

from __future__ import annotations

import json
import logging
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dart_hal.core.errors import FileTrouble, RecordingError, UsageError
from dart_hal.core.process.suspend import elapsed_ns
from dart_hal.core.types import nanoseconds
from dart_hal.recording.items import JSON, ZERO
from dart_hal.recording.pieces import PieceWriter
from dart_hal.recording.schemas import definition

if TYPE_CHECKING:
    from mcap.writer import Writer

    from dart_hal.recording.mcap_records import McapFile

# Name of the writer in a file. It is constant: a version would change the bytes of a run.
LIBRARY = "dart-hal recording 5"
# Recording time in a chunk [s]: a killed program loses at most that.
CHUNK_TIME = 0.05
# Name of the attachment that lists the cars of a file.
CARS_ATTACHMENT = "fleet"

# Receiver of every message as it is written: channel, ns since 1970, bytes. It must not wait.
Tap = Callable[[int, int, bytes], None]

log = logging.getLogger("dart_hal")


def make_mcap_writer(file: Any) -> Writer:
    """Return the MCAP writer of a run: without compression, with all checksums."""
    from mcap.writer import CompressionType, Writer

    writer = Writer(file, compression=CompressionType.NONE, enable_data_crcs=True)
    writer.start(profile="ros2", library=LIBRARY)
    return writer


class RunFile:
    """A file that one run writes, or several (``enter``). It is closed when the last one leaves.

    A full disk ends the recording and not the drive: ``trouble`` has the reason, a warning is
    logged, and the file written so far can be read. Raises OSError if it cannot be created,
    and FileTrouble if it exists.
    ``channels``: topic and type by number. ``taps`` receive all messages, also on a full disk.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.lock = threading.RLock()  # re-entrant: a signal may close in the middle of a write
        try:
            self._file = PieceWriter(self.path)
        except FileExistsError as error:
            raise FileTrouble(f"{self.path} exists, and a recording is never overwritten",
                              read=str(self.path), found="a file of that name",
                              expected="a new name", remedy="choose another name, or remove it"
                              ) from error
        self._writer = make_mcap_writer(self._file)
        self._begin()

    def _begin(self) -> None:
        self._schemas: dict[str, int] = {}
        self._cars: dict[str, str] = {}
        self._zero: int | None = None
        self._boot: int | None = None
        self._users = 0
        self._flushed: int | None = None
        self.closed = False
        self.trouble: FileTrouble | None = None
        self.channels: dict[int, tuple[str, str]] = {}
        self.taps: list[Tap] = []

    def enter(self, name: str) -> str:
        """Add a car of a fleet; return the prefix of its channels. Raises UsageError."""
        with self.lock:
            number = 1
            unique = name
            while unique in self._cars:
                number += 1
                unique = f"{name}-{number}"
            prefix = re.sub(r"\W", "_", unique, flags=re.ASCII) + "/"
            if prefix in {json.loads(text)["prefix"] for text in self._cars.values()}:
                raise UsageError(f"{self.path}: two cars would write to {prefix}", found=unique,
                                 expected="names that differ by letters and digits")
            self._cars[unique] = json.dumps({"prefix": prefix})
            self.attach(CARS_ATTACHMENT, JSON, json.dumps(self._cars), 0)
            return prefix

    def find_clock_zero(self, now: float | None) -> int:
        """Return the zero of a car's clock [ns since 1970]; now [s]: its present value.

        now is None for virtual time, whose zero is 1970. The calendar is read once, for the first
        car: the offset of later cars from it follows from the monotonic clock, so a calendar that
        is set meanwhile does not shift them. A file that begins with virtual time has no calendar.
        """
        boot = None if now is None else elapsed_ns() - nanoseconds(now)
        if self._zero is None:
            self._zero = 0 if now is None else time.time_ns() - nanoseconds(now)
        if boot is None:
            return self._zero
        if self._boot is None:
            self._boot = boot
        return max(self._zero + boot - self._boot, 0)

    def begin(self) -> None:
        """Count one more run."""
        self._users += 1

    def schema(self, kind: str) -> int:
        """Return the number of a message type, which is registered at its first use."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind))
        return self._schemas[kind]

    def channel(self, topic: str, kind: str, zero_ns: int) -> int:
        """Create a channel of a car with this zero of its clock; return its number."""
        number = self._register(topic, kind, zero_ns)
        self.channels[number] = (topic, kind)
        return number

    def _register(self, topic: str, kind: str, zero_ns: int) -> int:
        return int(self._writer.register_channel(topic, "cdr", self.schema(kind),
                                                 {ZERO: str(zero_ns)}))

    def attach(self, name: str, kind: str, text: str, ns: int) -> None:
        """Write a file or facts; the lock is taken."""
        with self.lock:
            if self.trouble is not None:
                return
            self._writer.add_attachment(ns, ns, name, kind, text.encode())

    def add(self, channel: int, ns: int, rest: int, data: bytes) -> None:
        """Write a message at ns and pass it to the taps. The caller has the lock."""
        for tap in self.taps:
            tap(channel, ns, data)
        if self.trouble is None:
            self._write(channel, ns, rest, data)

    def _write(self, channel: int, ns: int, rest: int, data: bytes) -> None:
        self._writer.add_message(channel, ns, data, ns, rest)
        # The absolute value, because stamps of host and car are not exactly in order.
        if self._flushed is None or abs(ns - self._flushed) >= CHUNK_TIME * 1e9:
            self.flush()
            self._flushed = ns

    def flush(self) -> None:
        """End the chunk. The recording ends with the first chunk that cannot be written."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._check_trouble()

    def _check_trouble(self) -> None:
        """Set ``trouble`` and log a warning after the first error of the disk."""
        why = self._file.trouble
        if why is None or self.trouble is not None:
            return
        self.trouble = FileTrouble(
            f"{self.path}: {why.strerror or why}", read=str(self.path),
            found=f"{type(why).__name__} {why.errno or ''}".strip(),
            remedy="keep the folder until the run ends" if isinstance(why, FileNotFoundError) else
            f"df -h {self.path.parent}, free some space; what was recorded is in the file")
        if self._users or self.closed:  # else it did not begin
            log.warning("%s: %s; the recording ends here, the drive goes on", self.path,
                        why.strerror or why)

    def leave(self) -> None:
        """Count one run less; the last one writes the index."""
        with self.lock:
            self._users -= 1
            if self._users <= 0:
                self.close()

    def close(self) -> None:
        """Write the index; idempotent."""
        with self.lock:
            if not self.closed:
                self.closed = True
                if self.trouble is None:
                    self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.close()
                self._check_trouble()


def prefix_topic(prefix: str, topic: str) -> str:
    """Return the topic of a car whose channels begin with ``prefix``."""
    return f"/{prefix}{topic[1:]}"


def split_car(path: Path | str) -> tuple[Path, str | None]:
    """Split ``fleet.mcap?car=red`` into file and car, unless a file has that name."""
    text, mark, car = str(path).rpartition("?car=")
    return (Path(text), car) if mark and not Path(path).exists() else (Path(path), None)


def select_car(found: McapFile, car: str | None) -> McapFile:
    """Return the part of one car, like a file with that car only. Raises RecordingError."""
    cars = found.metadata.get(CARS_ATTACHMENT, {})
    if not cars and car is None:
        return _select_channels(found, "")
    if car not in cars:
        example = f"{found.path}?car={next(iter(cars), 'NAME')}"
        raise RecordingError(
            f"{found.path}: holds {', '.join(cars)}" if cars else f"{found.path}: holds one car",
            found="no car named" if car is None else car, read=str(found.path),
            expected="one of them" if cars else "no ?car=",
            remedy=f"replay://{example}, RunReader('{example}')" if cars else str(found.path))
    try:
        entry = json.loads(cars[car])
        prefix = str(entry["prefix"])
        # Files until format 4 have a shift.
        shift = int(entry.get("shift_ns", 0))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as why:
        raise RecordingError(f"{found.path}: the list of its cars is damaged", found=repr(why),
                             read=str(found.path)) from why
    facts = {name.removeprefix(prefix): values for name, values in found.metadata.items()
             if name.startswith(prefix)}
    files = {name.removeprefix(prefix): text
             for name, text in found.metadata.get("files", {}).items() if name.startswith(prefix)}
    return replace(_select_channels(found, prefix),
                   zeros=dict.fromkeys(found.topics, shift) | found.zeros,
                   metadata={**facts, "files": files} if files else facts)


def _select_channels(found: McapFile, prefix: str) -> McapFile:
    """Return the channels that begin with ``prefix``, without it.

    Topics are absolute since format 5; those of older files become so.
    """
    own = {topic: "/" + rest.removeprefix(prefix) for topic in found.types
           if (rest := topic.removeprefix("/")).startswith(prefix)}
    return replace(found, topics={n: own[t] for n, t in found.topics.items() if t in own},
                   types={own[t]: kind for t, kind in found.types.items() if t in own})
