"""Check that a path is a regular file: a pipe waits for its writer, a device has no end."""

from __future__ import annotations

from pathlib import Path

from dart_hal.core.errors import RecordingError


def check_regular(path: Path) -> None:
    """Raise RecordingError for a path that exists and is neither file nor folder."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise RecordingError(f"{path}: is no file", found="a pipe, a socket or a device",
                             expected="a recording: a file that has an end", read=str(path),
                             remedy="write it to a file first, then name that")
