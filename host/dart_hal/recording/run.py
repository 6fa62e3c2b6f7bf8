"""A run: all data between host and car, in one MCAP file.

Channels:

- ``/rx``, ``/tx`` and ``/i2c``: raw bytes with their stamps;
- ``/command``: requested commands; ``/applied``: pulses at the pins;
- ``/log/...``: values that the program logged;
- ``/external_pose``: poses of a motion capture or another external source, if any;
- ``/battery``: voltage of the battery, NaN from when it is no longer measured, if any;
- ``/scan``: revolutions of a lidar, ``/camera/image/compressed``: images of a camera, if any.

Attachments have the identity of the car (HELLO), its files, the URL and the versions. Messages are
in chunks; chunks and attachments have checksums. All times are host times of the backend's clock in
s, >= 0. Stamps in the file count from 1970, those of virtual time from 0. Virtual time has no
random number, so the same run gives the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path
from struct import Struct
from struct import error as StructError  # noqa: N812
from types import TracebackType
from typing import TYPE_CHECKING, Any

from dart_hal.core.errors import FileTrouble, RecordingError
from dart_hal.core.notebook import card
from dart_hal.core.ports import Chunk
from dart_hal.core.types import Applied, ExternalPose, Image, Scan, State
from dart_hal.recording import cdr, stamp
from dart_hal.recording.items import IMPORT_NOTE, JSON, TOML
from dart_hal.recording.items import AppliedAt as AppliedAt
from dart_hal.recording.items import I2c as I2c
from dart_hal.recording.items import Logged as Logged
from dart_hal.recording.items import Recorded as Recorded
from dart_hal.recording.items import RecordedCommand as RecordedCommand
from dart_hal.recording.log import PREFIX, Value
from dart_hal.recording.run_file import RunFile, prefix_topic, select_car, split_car
from dart_hal.wire.messages import PROTO, SCHEMA

if TYPE_CHECKING:
    from dart_hal.recording.mcap_records import McapFile

# Message types.
_RAW = "std_msgs/msg/UInt8MultiArray"
_TEXT = "std_msgs/msg/String"
# Channels of every run; those below are created with their first message.
_CHANNELS = (
    ("/rx", _RAW), ("/tx", _RAW), ("/i2c", _RAW),
    ("/command", "dart_msgs/msg/Command"), ("/applied", "dart_msgs/msg/Applied"),
    ("/odom", "nav_msgs/msg/Odometry"), ("/imu", "sensor_msgs/msg/Imu"),
    ("/drive", "ackermann_msgs/msg/AckermannDriveStamped"),
)
_NUMBER = "std_msgs/msg/Float64"
_NUMBERS = "std_msgs/msg/Float64MultiArray"
_POSES = ("/external_pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
_SCANS = ("/scan", "dart_msgs/msg/LidarScan")
_BATTERY = ("/battery", _NUMBER)
_IMAGES = ("/camera/image/compressed", "sensor_msgs/msg/CompressedImage")
_I2C = Struct("<BHH")  # address, bytes written, bytes read


class RunWriter:
    """Writes a run; a context manager. Methods may be called in any order, by any thread.

    path: a new file, or the file of several cars. url, car: of the opened backend. files: texts of
    the car's files by name. versions: of the library and other packages. start [s]: the clock when
    the backend was opened. now [s]: the present clock, which gives its zero since 1970; None:
    virtual time. map_std [m]: standard error of the walls of the map, for poses by the car's lidar.
    Raises OSError if the file cannot be written; ``trouble`` is the reason for which
    writing ended later.
    """

    def __init__(self, path: Path | str | RunFile, *, url: str = "", car: str = "",
                 start: float = 0.0, files: Mapping[str, str] | None = None,
                 versions: Mapping[str, str] | None = None, now: float | None = None,
                 map_std: float = 0.0) -> None:
        self._file = path if isinstance(path, RunFile) else RunFile(path)
        self._lock = self._file.lock
        self.path = self._file.path
        self._zero = self._file.find_clock_zero(now)
        self._prefix = path.enter(car) if isinstance(path, RunFile) else ""
        self._now = stamp.split(start)[0] + self._zero
        # Channels of every run exist from its beginning, so that the file of a killed program can
        # be read as a run.
        for _, kind in _CHANNELS:
            self._file.schema(kind)
        self._channels = {topic: self._channel(topic, kind) for topic, kind in _CHANNELS}
        self.note("run", {
            "url": url, "car": car, "start": repr(float(start)), "schema": f"{SCHEMA:08x}",
            "proto": str(PROTO), **({"map_std": repr(map_std)} if map_std else {}),
            **dict(versions or {})})
        for name, text in (files or {}).items():
            self._attach(name, TOML, text)
        self._file.flush()
        if self._file.trouble is not None:
            raise self._file.trouble
        self._file.begin()
        self._closed = False

    @property
    def file(self) -> RunFile:
        """File of the run, with its ``taps``."""
        return self._file

    @property
    def trouble(self) -> FileTrouble | None:
        """Reason for which writing ended, such as a full disk; None while it continues."""
        return self._file.trouble

    def rx(self, data: bytes, t: float) -> None:
        """Write bytes from the Nano; t: arrival of the last one."""
        self._add("/rx", cdr.encode_byte_array(data), t)

    def tx(self, data: bytes, t: float) -> None:
        """Write bytes to the Nano."""
        self._add("/tx", cdr.encode_byte_array(data), t)

    def i2c(self, address: int, wrote: bytes, t: float, read: bytes = b"") -> None:
        """Write one transaction on the bus of the car."""
        self._add("/i2c", cdr.encode_byte_array(
            _I2C.pack(address, len(wrote), len(read)) + wrote + read), t)

    def command(self, t: float, steering: float, throttle: float, source: str = "user") -> None:
        """Write a requested command, before limits: rad, -1..1. NaN and inf are kept."""
        self._add("/command", cdr.encode_command(steering, throttle, source), t)

    def applied(self, t: float, applied: Applied) -> None:
        """Write the pulses at the pins from t on; call it when they change."""
        self._add("/applied", cdr.encode_applied(applied), t)

    def state(self, state: State) -> None:
        """Write the ROS 2 channels of one State: odometry, IMU, drive."""
        self._add("/odom", cdr.encode_odometry(state, self._zero), state.t)
        imu = cdr.encode_imu(state, self._zero)
        if imu is not None:
            self._add("/imu", imu, state.t)
        self._add("/drive", cdr.encode_drive(state, self._zero), state.t)

    def log(self, t: float, channels: Mapping[str, Value]) -> None:
        """Write numbers and arrays that the program logs, by name (``log.LogNames.take``).

        A channel is created with its first value. A closed run ignores the call.
        """
        with self._lock:
            if self._closed:
                return
            for name, value in channels.items():
                kind, data = ((_NUMBER, cdr.encode_number(value)) if isinstance(value, float)
                              else (_NUMBERS, cdr.encode_numbers(value)))
                self._add_to(PREFIX + name, kind, data, t)

    def pose(self, pose: ExternalPose) -> None:
        """Write an external pose at its arrival; a run without any has no channel for it."""
        with self._lock:
            if not self._closed:
                self._add_to(*_POSES, cdr.encode_external_pose(pose), pose.arrival)

    def scan(self, scan: Scan) -> None:
        """Write a revolution of the lidar at its arrival; a run without one has no channel."""
        with self._lock:
            if not self._closed:
                self._add_to(*_SCANS, cdr.encode_scan(scan), scan.arrival)

    def battery(self, t: float, voltage: float) -> None:
        """Write a voltage [V], NaN if it is lost; a run without a sensor has no channel."""
        with self._lock:
            if not self._closed:
                self._add_to(*_BATTERY, cdr.encode_number(voltage), t)

    def image(self, image: Image) -> None:
        """Write an image of the camera at its arrival; a run without one has no channel."""
        with self._lock:
            if not self._closed:
                self._add_to(*_IMAGES, cdr.encode_image(image, self._zero), image.arrival)

    def hello(self, values: Mapping[str, Any]) -> None:
        """Write the identity of the Nano: the raw values of HELLO by name."""
        self.note("hello", {"values": json.dumps(values, sort_keys=True)})

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write facts about the run; the newest of a name is valid."""
        self._attach(name, JSON, json.dumps(dict(values)))

    def _channel(self, topic: str, kind: str) -> int:
        name = prefix_topic(self._prefix, topic) if self._prefix else topic
        return self._file.channel(name, kind, self._zero)

    def _attach(self, name: str, kind: str, text: str) -> None:
        self._file.attach(self._prefix + name, kind, text, self._now)

    def _add_to(self, topic: str, kind: str, data: bytes, t: float) -> None:
        """Write to a channel that its first message creates. The caller has the lock."""
        # Sensors that a car has not leave no empty channel.
        if topic not in self._channels:
            self._channels[topic] = self._channel(topic, kind)
        self._add(topic, data, t)

    def _add(self, topic: str, data: bytes, t: float) -> None:
        # A stamp in the file has whole nanoseconds; the rest of a float keeps a replay exact.
        ns, rest = stamp.split(t)
        with self._lock:
            self._now = ns + self._zero
            self._file.add(self._channels[topic], self._now, rest, data)

    def close(self) -> None:
        """Leave the file; the last run of a file writes the index. Idempotent."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._file.leave()

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


class RunReader:
    """Reads a run, of a file of several cars that of one: ``fleet.mcap?car=red``.

    meta: the facts "run" (url, car, start, schema, versions). files: texts of the car's files.
    complete: False if the end is missing. damaged: True if bytes before the end were skipped.
    notices: messages for the user. Raises RecordingError with the name of the file.
    """

    def __init__(self, path: Path | str) -> None:
        # Imported by a reader: a program that drives reads no file.
        from dart_hal.recording.mcap_records import notices, read_mcap

        self.path, car = split_car(path)
        self._mcap = found = select_car(read_mcap(self.path), car)
        self.damaged = bool(found.damages)
        if "/rx" not in found.topics.values():
            self._raise_refusal(found)
        self.complete = found.complete
        self.meta = found.metadata.get("run", {})
        self.files = found.metadata.get("files", {})
        self.notices: tuple[str, ...] = notices(found)

    def _raise_refusal(self, found: McapFile) -> None:
        """Raise RecordingError for another kind of file, a damaged or an oversized one.

        A run that was killed at once has no channels: it is read as empty.
        """
        if found.oversized:
            from dart_hal.recording.expansion import refusal

            raise refusal(str(self.path), f"a chunk: {found.oversized}")
        if self.damaged:
            raise RecordingError(f"{self.path}: a record is damaged", read=str(self.path),
                                 found=f"no channel /rx, damaged at byte {found.damages[0].offset}",
                                 likely="the file was changed or copied badly")
        if IMPORT_NOTE in found.metadata:
            raise RecordingError(f"{self.path}: is an imported recording, which has no bytes of a "
                                 "Nano", read=str(self.path), found="channels "
                                 + ", ".join(sorted(found.topics.values())),
                                 expected="a run of dart-hal record",
                                 remedy="identify, evaluate, diagnose and data check read it")
        if found.topics:
            raise RecordingError(f"{self.path}: is not a run of this library",
                                 read=str(self.path),
                                 found="channels " + ", ".join(sorted(found.topics.values())),
                                 expected="a channel /rx with the bytes of the Nano")

    def __repr__(self) -> str:
        return f"<RunReader {self.path}: {', '.join(f'{k} {v}' for k, v in self._rows())}>"

    def _repr_html_(self) -> str:
        return card(f"Run {self.path}", self._rows())

    def _rows(self) -> Iterator[tuple[str, str]]:
        """Yield the entries of the summary: car, time, completeness, files, messages."""
        counts, first, last = self._mcap.extent()
        yield "car", f"{self.meta.get('car', 'unknown')} at {self.meta.get('url', 'unknown')}"
        if self.zero_ns:
            began = datetime.fromtimestamp((first + self.zero_ns) // 10**9, timezone.utc)
            yield "began", f"{began:%Y-%m-%d %H:%M:%S} UTC"
        yield "lasts", f"{(last - first) * 1e-9:.1f} s"
        yield "whole", "yes" if self.complete and not self.damaged else "no: see notices"
        yield "files", " ".join(self.files) or "none"
        yield "messages", " ".join(f"{topic}:{n}" for topic, n in sorted(counts.items()) if n)

    @property
    def zero_ns(self) -> int:
        """Zero of the car's clock [ns since 1970]; 0 for virtual time, and until format 4."""
        # All channels of a run have one zero. Those of other tools state none.
        return max((self._mcap.zeros.get(n, 0) for n in self._mcap.topics), default=0)

    @property
    def start(self) -> float:
        """Clock [s] when the backend was opened."""
        try:
            return float(self.meta.get("start", "0.0"))
        except ValueError as why:
            raise RecordingError(f"{self.path}: the run record is damaged", found=str(why),
                                 read=str(self.path)) from why

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """All facts by name."""
        return self._mcap.metadata

    @property
    def hello(self) -> dict[str, Any] | None:
        """Raw values of HELLO by name, None if it was not recorded."""
        found = self._mcap.metadata.get("hello")
        if found is None:
            return None
        try:
            values: dict[str, Any] = json.loads(found["values"])
        except (ValueError, LookupError, RecursionError) as why:
            raise RecordingError(f"{self.path}: the HELLO record is damaged", found=repr(why),
                                 read=str(self.path)) from why
        return values

    def chunks(self) -> Iterator[Chunk]:
        """Return the bytes from the Nano in recorded order."""
        return (item for item in self.replay() if isinstance(item, Chunk))

    def sent(self) -> Iterator[Chunk]:
        """Return the bytes to the Nano in recorded order."""
        return self._decode({"/tx": _decode_chunk})

    def replay(self) -> Iterator[Chunk | AppliedAt]:
        """Return the input of a replay in recorded order: received bytes and applied pulses."""
        # Pulses depend on the time at which they were written, which a replay cannot compute again:
        # they are input of a replay, like the bytes.
        applied = _decode_applied_text if self._is_text("/applied") else _decode_applied
        return self._decode({"/rx": _decode_chunk, "/applied": applied})

    def applied(self) -> Iterator[AppliedAt]:
        """Return the pulses at the pins, at each change."""
        return (item for item in self.replay() if isinstance(item, AppliedAt))

    def commands(self) -> Iterator[RecordedCommand]:
        """Return the requested commands in recorded order."""
        return self._decode({"/command": _decode_command_text if self._is_text("/command")
                              else _decode_command})

    def _is_text(self, topic: str) -> bool:
        """Return whether a topic has JSON texts, as commands and pulses had until format 3."""
        return self._mcap.types.get(topic) == _TEXT

    def logged(self) -> Iterator[Logged]:
        """Return the values that the program logged, in recorded order."""
        def make_decoder(topic: str, kind: str) -> Callable[[float, bytes], Logged]:
            name = topic.removeprefix(PREFIX)
            read = _READERS[kind]
            return lambda t, data: Logged(t, name, read(data))

        return self._decode({topic: make_decoder(topic, kind)
                             for topic, kind in self._mcap.types.items()
                             if topic.startswith(PREFIX) and kind in _READERS})

    def i2c(self) -> Iterator[I2c]:
        """Return the transactions of the bus in recorded order."""
        return self._decode({"/i2c": _decode_transaction})

    def poses(self) -> Iterator[ExternalPose]:
        """Return the external poses in order of arrival."""
        return self._decode({_POSES[0]: lambda t, data: cdr.decode_external_pose(data, t)})

    def scans(self) -> Iterator[Scan]:
        """Return the revolutions of the lidar, as received, in order of arrival."""
        return self._decode({_SCANS[0]: lambda t, data: cdr.decode_scan(data, t)})

    def battery(self) -> Iterator[tuple[float, float]]:
        """Return the readings of the battery in order: time [s], V (NaN: it was lost).

        A channel of that name with messages of another type is another program's.
        """
        if self._mcap.types.get(_BATTERY[0]) != _NUMBER:
            return iter(())
        return self._decode({_BATTERY[0]: lambda t, data: (t, cdr.decode_number(data))})

    def images(self) -> Iterator[Image]:
        """Return the images of the camera in order of arrival."""
        return self._decode({_IMAGES[0]: lambda t, data: cdr.decode_image(data, t, self.zero_ns)})

    def messages(self) -> list[Recorded]:
        """Return all messages with a known definition, in order of time."""
        zero = self.zero_ns
        types = self._mcap.types
        return sorted((Recorded(m.topic, types[m.topic], m.ns + zero, m.data)
                       for m in self._mcap.messages() if types[m.topic] in self.definitions),
                      key=lambda message: message.ns)

    @property
    def definitions(self) -> dict[str, str]:
        """Definitions of the message types by name, each with its parts."""
        return self._mcap.definitions

    def _decode(self, decoders: Mapping[str, Callable[[float, bytes], Any]]) -> Iterator[Any]:
        """Yield the messages of some topics as values, in file order."""
        for m in self._mcap.messages(decoders):
            try:
                yield decoders[m.topic](stamp.join(m.ns, m.rest), m.data)
            except (StructError, ValueError, LookupError, TypeError, OverflowError,
                    RecursionError) as why:
                raise RecordingError(f"{self.path}: a message of {m.topic} is damaged",
                                     found=repr(why), read=str(self.path)) from why


_READERS: dict[str, Callable[[bytes], Value]] = {_NUMBER: cdr.decode_number,
                                                 _NUMBERS: cdr.decode_numbers}


def _decode_chunk(t: float, data: bytes) -> Chunk:
    return Chunk(cdr.decode_byte_array(data), t)


def _decode_command(t: float, data: bytes) -> RecordedCommand:
    return RecordedCommand(t, *cdr.decode_command(data))


def _decode_command_text(t: float, data: bytes) -> RecordedCommand:
    v = json.loads(cdr.decode_string(data))
    return RecordedCommand(t, v["steering"], v["throttle"], v["source"])


def _decode_transaction(t: float, data: bytes) -> I2c:
    raw = cdr.decode_byte_array(data)
    address, wrote, read = _I2C.unpack_from(raw)
    at = _I2C.size + wrote
    return I2c(t, address, raw[_I2C.size:at], raw[at:at + read])


def _decode_applied(t: float, data: bytes) -> AppliedAt:
    return AppliedAt(t, cdr.decode_applied(data))


def _decode_applied_text(t: float, data: bytes) -> AppliedAt:
    v = json.loads(cdr.decode_string(data))
    return AppliedAt(t, Applied(v["steering"], v["throttle"], v["steering_us"], v["throttle_us"],
                                tuple(v["limited"])))
