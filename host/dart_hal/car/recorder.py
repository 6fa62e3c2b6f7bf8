"""Recording of an open car: bytes both ways, commands, pulses, who it was."""

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


class Recorded:
    """What a program may add to the recording of its car; nothing is done where none is made."""

    files: CarFiles
    _engine: Engine
    _recorder: RunWriter | None

    def __init__(self) -> None:
        self._log_names = LogNames()
        self.logged: dict[str, float] = {}
        """The newest number of each name that ``log`` was given; arrays are left out."""

    def start_recording(self, path: str | Path) -> Path | None:
        """Record from now on, until ``end_recording`` or the end; a file that is there is kept
        under another name, which is returned.

        A replay of it begins its estimators where it begins, so the first second differs from
        what the program saw; bytes of the I2C bus are there only in a recording that began with
        ``Car.open``. Raises UsageError where one is under way already, OSError.
        """
        if self._recorder is not None:
            raise UsageError("a recording is under way", found=str(self._recorder.path),
                             expected="one at a time", remedy="car.end_recording()")
        kept = keep_old(path)
        with self._engine.lock:
            self._recorder = start_recording(self._engine, self.files, path)
            self._engine.start()
            self._engine.ask()  # a HELLO among the bytes, by which a replay begins
        return kept

    def end_recording(self) -> None:
        """Close the file; nothing is done where none is written."""
        if self._recorder is not None:
            with self._engine.lock:
                leave_recording(self._engine, self._recorder)
                recorder, self._recorder = self._recorder, None
            recorder.close()

    @property
    def recording(self) -> Path | None:
        """The file that is being written; None: none is."""
        writer = self._recorder
        return None if writer is None or isinstance(writer.file, LiveFile) else writer.path

    @property
    def recording_trouble(self) -> DartHalError | None:
        """Why the recording ended before the drive, as on a full disk; None while it goes on."""
        return self._recorder.trouble if self._recorder is not None else None

    def messages(self) -> RunFile:
        """Where every message passes that a recording gets, made or not: ``taps`` hear them."""
        if self._recorder is None:
            self._recorder = start_recording(self._engine, self.files, LiveFile())
        return self._recorder.file

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put a record of this name into the recording; the newest counts.

        Raises UsageError, recording or not, for values that are not text.
        """
        check_note(name, values)
        if self._recorder is not None:
            self._recorder.note(name, values)

    def log(self, name: str, value: object) -> None:
        """Record a number, an array of any shape, or a dict of them, under ``name``, now.

        ``name`` is of letters, digits and _, its parts joined by /: ``mpc/cost``; an entry of a
        dict becomes the channel ``name/key``. NaN and inf are values, True is 1. Stamped in
        the car's clock. Raises LogError for another name or value, recording or not.
        """
        channels = self._log_names.take(name, value)
        self.logged |= {one: v for one, v in channels.items() if isinstance(v, float)}
        if self._recorder is not None:
            self._recorder.log(self._engine.now, channels)


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
    engine.hooks.recorder = writer
    engine.recorder = writer
    engine.listeners.append(writer.state)
    if engine.poses is not None:
        engine.poses.record = writer.pose
    if engine.scans is not None:
        engine.scans.record = writer.scan
    if engine.images is not None:
        engine.images.record = writer.image
    if isinstance(backend.bus, RecordedBus):
        backend.bus.recorder = writer
    return writer


def leave_recording(engine: Engine, writer: RunWriter) -> None:
    """The engine writes nothing more into it; the inverse of ``start_recording``."""
    engine.hooks.recorder = engine.recorder = None
    engine.listeners = [one for one in engine.listeners if one != writer.state]
    if engine.poses is not None:
        engine.poses.record = lambda pose: None
    if engine.scans is not None:
        engine.scans.record = lambda scan: None
    if engine.images is not None:
        engine.images.record = lambda image: None
    if isinstance(engine.backend.bus, RecordedBus):
        engine.backend.bus.recorder = None
