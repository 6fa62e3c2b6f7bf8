"""``car.recorder``: bytes both ways, commands, pulses, who the car was."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dart_hal.car.engine import Engine
from dart_hal.car.misuse import check_note
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.text_file import read_text
from dart_hal.recording.bus import RecordedBus
from dart_hal.recording.live_file import LiveFile
from dart_hal.recording.log import LogNames
from dart_hal.recording.run import RunWriter
from dart_hal.recording.run_file import RunFile

Record = str | Path | RunFile
"""Where a run goes: a file of its own, or one that the cars of a fleet share."""
FILES = ("car.toml", "calibration.toml", "model.toml")


class Recorder:
    """The recording of an open car; what a program adds is dropped where none is made.

    ``logged``: the newest number of each name that ``log`` was given; arrays are left out.
    """

    def __init__(self, engine: Engine, files: CarFiles, record: Record | None) -> None:
        self.logged: dict[str, float] = {}
        self._engine, self._files = engine, files
        self._log_names = LogNames()
        self._writer = start_recording(engine, files, record) if record else None

    def start(self, path: str | Path) -> Path | None:
        """Record from now on, until ``end`` or the car is closed.

        A file that is there is kept under another name, which is returned. A replay begins its
        estimators where the recording begins, so the first second differs from what the program
        saw. Bytes of the I2C bus are there only in a recording that began with ``Car.open``.
        Raises UsageError where one is under way already, OSError.
        """
        if self._writer is not None:
            raise UsageError("a recording is under way", found=str(self._writer.path),
                             expected="one at a time", remedy="car.recorder.end()")
        kept = keep_old(path)
        with self._engine.lock:
            self._writer = start_recording(self._engine, self._files, path)
            self._engine.start()
            self._engine.ask()  # a HELLO among the bytes, by which a replay begins
        return kept

    def end(self) -> None:
        """Close the file; nothing is done where none is written."""
        if self._writer is not None:
            with self._engine.lock:
                leave_recording(self._engine, self._writer)
                writer, self._writer = self._writer, None
            writer.close()

    def close(self) -> None:
        """Close the file, as the last of what an open car does."""
        if self._writer is not None:
            self._writer.close()

    def disown(self) -> None:
        """Forget the file in a forked child: its lock may be held by a thread that is not there."""
        self._writer = None

    @property
    def path(self) -> Path | None:
        """The file that is being written; None: none is."""
        writer = self._writer
        return None if writer is None or isinstance(writer.file, LiveFile) else writer.path

    @property
    def trouble(self) -> DartHalError | None:
        """Why the recording ended before the drive, as on a full disk; None while it goes on."""
        return self._writer.trouble if self._writer is not None else None

    def messages(self) -> RunFile:
        """Return where every message passes that a recording gets, made or not.

        Its ``taps`` hear them.
        """
        if self._writer is None:
            self._writer = start_recording(self._engine, self._files, LiveFile())
        return self._writer.file

    def command(self, t: float, steering: float, throttle: float, source: str) -> None:
        """Record what a program asked for."""
        if self._writer is not None:
            self._writer.command(t, steering, throttle, source)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put a record of this name into the recording; the newest counts.

        Raises UsageError, recording or not, for values that are not text.
        """
        check_note(name, values)
        if self._writer is not None:
            self._writer.note(name, values)

    def log(self, name: str, value: object) -> None:
        """Record a number, an array or a dict of them, as ``Car.log`` says."""
        channels = self._log_names.take(name, value)
        self.logged |= {one: v for one, v in channels.items() if isinstance(v, float)}
        if self._writer is not None:
            self._writer.log(self._engine.now, channels)


def keep_old(path: Record) -> Path | None:
    """Move a file that stands in the way of a new recording to run.1.mcap, run.2.mcap, ...

    Returns its new name, None when there was none.
    """
    if isinstance(path, RunFile):
        return None
    path = Path(path)
    if not path.is_file():
        return None
    number = 1
    while (kept := path.with_suffix(f".{number}{path.suffix}")).exists():
        number += 1
    return path.rename(kept)


def start_recording(engine: Engine, files: CarFiles, path: Record) -> RunWriter:
    """Begin an MCAP file of this run, or its part in one of several cars; ``engine`` writes into
    it from now on."""
    backend = engine.backend
    texts = dict(backend.measured)
    if not texts:
        texts = {name: read_text(files.folder / name)
                 for name in FILES if (files.folder / name).is_file()}
    if backend.car_toml is not None:
        texts["car.toml"] = backend.car_toml
    if not isinstance(path, RunFile):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    writer = RunWriter(path, url=backend.url.text, car=files.config.name, start=engine.now,
                       files=texts, now=None if backend.virtual else engine.now)
    engine.hooks.writer = writer
    engine.writer = writer
    engine.listeners.append(writer.state)
    if engine.poses is not None:
        engine.poses.record = writer.pose
    if engine.lidar is not None:
        engine.lidar.record = writer.scan
    if engine.camera is not None:
        engine.camera.record = writer.image
    if isinstance(backend.bus, RecordedBus):
        backend.bus.recorder = writer
    return writer


def leave_recording(engine: Engine, writer: RunWriter) -> None:
    """The engine writes nothing more into it; the inverse of ``start_recording``."""
    engine.hooks.writer = engine.writer = None
    engine.listeners = [one for one in engine.listeners if one != writer.state]
    if engine.poses is not None:
        engine.poses.record = lambda pose: None
    if engine.lidar is not None:
        engine.lidar.record = lambda scan: None
    if engine.camera is not None:
        engine.camera.record = lambda image: None
    if isinstance(engine.backend.bus, RecordedBus):
        engine.backend.bus.recorder = None
