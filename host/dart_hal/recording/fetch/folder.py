"""Where the recordings of this user are: ``$DART_DATA``, else a folder of dart-hal."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from dart_hal.core.errors import RecordingError


def data_folder() -> Path:
    """``$DART_DATA`` if set, else ``~/.local/share/dart-hal/recordings``; it need not exist."""
    named = os.environ.get("DART_DATA")
    if named:
        return Path(named).expanduser()
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "dart-hal" / "recordings"


def find(paths: Iterable[str | Path]) -> list[Path]:
    """Each path as it is, or within ``data_folder()`` when it exists only there.

    So ``19_step_input_data`` names that folder of the published set. No path
    at all means the whole data folder. Errors: RecordingError, with what to
    type, when there is neither a path nor such a folder.
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
