"""Data folder of this user: ``$DART_DATA``, else a folder of dart-hal."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from dart_hal.core.errors import RecordingError


def data_folder() -> Path:
    """Return ``$DART_DATA`` if set, else ``~/.local/share/dart-hal/recordings``."""
    named = os.environ.get("DART_DATA")
    if named:
        return Path(named).expanduser()
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "dart-hal" / "recordings"


def find(paths: Iterable[str | Path]) -> list[Path]:
    """Return each path unchanged, or within ``data_folder()`` if it exists only there.

    So ``19_step_input_data`` names that folder of the published set. Without paths, return the data
    folder. Errors: RecordingError if there is neither a path nor a data folder.
    """
    given = [Path(p) for p in paths]
    home = data_folder()
    if given:
        return [home / p if not p.exists() and (home / p).exists() else p for p in given]
    if home.is_dir():
        return [home]
    raise RecordingError(f"no recording named, and no data folder at {home}",
                         found="no FILES", expected="files or folders of recordings",
                         remedy="dart-hal data fetch ; or name files, or set $DART_DATA")
