"""``car.recorder``: records bytes in both directions, commands, pulses and the car's files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dart_hal.car.engine import Engine
from dart_hal.car.misuse import check_note
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.text_file import read_text
from dart_hal.recording.bus import RecordedBus
from dart_hal.recording.log import LogNames

if TYPE_CHECKING:
    from dart_hal.recording.run import RunWriter
    from dart_hal.recording.run_file import RunFile

# Target of a recording: a file of its own, or one that the cars of a fleet share.
Record: TypeAlias = "str | Path | RunFile"
# Files of a car that go into the recording.
CAR_FILES = ("car.toml", "calibration.toml", "model.toml")


class Recorder:
    """Recording of an open car, reached by ``car.recorder``.

    Without a recording, what a program adds is checked and then dropped.

    Attributes:
        logged: newest number of each name that was given to ``log``, without arrays.

    The examples of the methods use this car, which records nothing yet::

        from dart_hal import Car
        car = Car.open("sim://?nano=mock")
    """

    def __init__(self, engine: Engine, files: CarFiles, record: Record | None) -> None:
        self.logged: dict[str, float] = {}
        self._engine = engine
        self._files = files
        self._log_names = LogNames()
        self._writer = start_recording(engine, files, record) if record else None

    def start(self, path: str | Path) -> Path | None:
        """Start a recording, which goes on until ``end`` or until the car is closed.

        A replay starts its estimators where the recording starts, so its first second differs from
        what the program saw. Bytes of the I2C bus are only in a recording made by ``Car.open``.

        Args:
            path: MCAP file.

        Returns:
            New name of a file that was there already, such as run.1.mcap; None: there was none.

        Raises:
            UsageError: a recording is under way already.
            OSError: the file cannot be made.

        Example:
            >>> car.recorder.start("run.mcap")
            >>> car.recorder.end()
            >>> car.recorder.start("run.mcap").name
            'run.1.mcap'
        """
        if self._writer is not None:
            raise UsageError("a recording is under way", found=str(self._writer.path),
                             expected="one at a time", remedy="car.recorder.end()")
        kept = rename_existing(path)
        with self._engine.lock:
            self._writer = start_recording(self._engine, self._files, path)
            self._engine.start()
            self._engine.request_hello()  # a HELLO among the bytes, by which a replay begins
        return kept

    def end(self) -> None:
        """End the recording and close its file; does nothing without one.

        Example:
            >>> car.recorder.start("run.mcap")
            >>> car.recorder.end()
            >>> car.recorder.path is None
            True
        """
        if self._writer is not None:
            with self._engine.lock:
                detach_recording(self._engine, self._writer)
                writer, self._writer = self._writer, None
            writer.close()

    def close(self) -> None:
        """Close the file, as the last step of closing the car.

        Example:
            >>> car.recorder.close()
        """
        if self._writer is not None:
            self._writer.close()

    def disown(self) -> None:
        """Give up the file in a forked child, where no thread can release its lock.

        Example:
            >>> car.recorder.disown()
            >>> car.recorder.path is None
            True
        """
        self._writer = None

    @property
    def path(self) -> Path | None:
        """Return the file that is being written; None: there is no recording.

        Example:
            >>> car.recorder.start("run.mcap")
            >>> car.recorder.path.name
            'run.mcap'
        """
        from dart_hal.recording.live_file import LiveFile

        writer = self._writer
        return None if writer is None or isinstance(writer.file, LiveFile) else writer.path

    @property
    def trouble(self) -> DartHalError | None:
        """Return why the recording ended before the drive, such as a full disk; None: it goes on.

        Example:
            >>> car.recorder.trouble is None
            True
        """
        return self._writer.trouble if self._writer is not None else None

    def messages(self) -> RunFile:
        """Return the stream of recorded messages, whether they are written to a file or not.

        Returns:
            The file, or a substitute. Functions in its ``taps`` are called as
            ``tap(channel, ns, data)`` for each message, and must not wait.

        Example:
            >>> count = []
            >>> car.recorder.messages().taps.append(lambda channel, ns, data: count.append(channel))
            >>> state = next(car.states())
            >>> len(count) > 0
            True
        """
        if self._writer is None:
            from dart_hal.recording.live_file import LiveFile

            self._writer = start_recording(self._engine, self._files, LiveFile())
        return self._writer.file

    def command(self, t: float, steering: float, throttle: float, source: str) -> None:
        """Record a command of a program, before limits.

        Args:
            t: time [s] of the car's clock.
            steering: angle [rad], left positive.
            throttle: -1 to 1.
            source: name of the sender.

        Example:
            >>> car.recorder.command(car.now, 0.1, 0.2, "user")
        """
        if self._writer is not None:
            self._writer.command(t, steering, throttle, source)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Put texts into the recording under a name; of several with one name the newest counts.

        Args:
            name: name of the note.
            values: texts by key.

        Raises:
            UsageError: a value is not text, whether a recording is made or not.

        Example:
            >>> car.recorder.note("track", {"surface": "carpet"})
        """
        check_note(name, values)
        if self._writer is not None:
            self._writer.note(name, values)

    def log(self, name: str, value: object) -> None:
        """Record a number, an array or a dict of them under a name, as ``Car.log``.

        Args:
            name: letters, digits and _; parts are joined by /, as in ``mpc/cost``.
            value: a number, an array of any shape, or a dict of them.

        Raises:
            LogError: the name or the value is not allowed, whether a recording is made or not.

        Example:
            >>> car.recorder.log("mpc/cost", 1.5)
            >>> car.recorder.logged
            {'mpc/cost': 1.5}
        """
        channels = self._log_names.take(name, value)
        self.logged |= {one: v for one, v in channels.items() if isinstance(v, float)}
        if self._writer is not None:
            self._writer.log(self._engine.now, channels)


def rename_existing(path: Record) -> Path | None:
    """Rename an existing file to run.1.mcap, run.2.mcap, ..., to make way for a new recording.

    Returns its new name; None when there was none.
    """
    from dart_hal.recording.run_file import RunFile

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
    """Start an MCAP file of this run, or the part of one car in a shared file.

    From now on ``engine`` writes into it.
    """
    # Imported here: a program that imports ``Car`` and records nothing starts sooner.
    from dart_hal.recording.run import RunWriter
    from dart_hal.recording.run_file import RunFile

    backend = engine.backend
    # The files by which the car drives: of the backend, else of the folder.
    texts = dict(backend.measured)
    if not texts:
        texts = {name: read_text(files.folder / name)
                 for name in CAR_FILES if (files.folder / name).is_file()}
    if backend.car_toml is not None:
        texts["car.toml"] = backend.car_toml
    if not isinstance(path, RunFile):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    writer = RunWriter(path, url=backend.url.text, car=files.config.name, start=engine.now,
                       files=texts, now=None if backend.virtual else engine.now,
                       map_std=backend.poses.map_std if (
                           backend.poses is not None and backend.poses.on_board) else 0.0)
    # Everything that passes goes to the writer from now on.
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


def detach_recording(engine: Engine, writer: RunWriter) -> None:
    """Let the engine write nothing more; the inverse of ``start_recording``."""
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
