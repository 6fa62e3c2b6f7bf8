"""Recordings: MCAP runs with the raw bytes, CSV tables, and the DART recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dart_hal.compat import load_moved_name
from dart_hal.core.errors import RecordingError


def open_writer(path: Path | str, **about: Any) -> Any:
    """Return a writer by suffix: ``.mcap``, ``.dart.csv`` (ten columns) or ``.csv``.

    about: arguments of ``run.RunWriter`` (url, car, files, versions, start); tables ignore them.
    Raises RecordingError for another suffix, and FileTrouble for an .mcap file that exists.
    """
    path = Path(path)
    if path.suffix == ".mcap":
        from dart_hal.recording.run import RunWriter

        return RunWriter(path, **about)
    from dart_hal.recording.table import CsvWriter, DartCsvWriter

    if path.name.endswith(".dart.csv"):
        return DartCsvWriter(path)
    if path.suffix == ".csv":
        return CsvWriter(path)
    raise RecordingError(f"{path}: no writer for this suffix", found=path.suffix or "none",
                         expected=".mcap, .csv or .dart.csv")


def __getattr__(name: str) -> Any:
    """Return a name that was here in version 0.1."""
    return load_moved_name(__name__, name)
