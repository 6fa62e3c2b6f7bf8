"""The published recordings: their list, and the repository of their authors."""

from __future__ import annotations

from functools import cache
from pathlib import Path

NOTICE = Path(__file__).with_name("LICENSE")
LIST = Path(__file__).with_name("published.txt")
REPOSITORY = "https://github.com/Lorenzo-Lyons/DART"
COMMIT = "7c30162"
# Folders of the repository with the recordings.
ROOTS = ("System_identification/Data", "ROS_packages/racecar_pkg/src/Data")

RAW_URL = (REPOSITORY.replace("https://github.com", "https://raw.githubusercontent.com")
           + f"/{COMMIT}")
ARCHIVE_URL = f"{REPOSITORY}/archive/{COMMIT}.zip"
MANUAL_ADVICE = (f"git clone {REPOSITORY} ; dart-hal data fetch --from DART"
           " ; or set $DART_DATA to a folder that has them")
RETRY_ADVICE = "the same command resumes the download ; or "


def load() -> dict[str, str]:
    """Return the SHA-256 of each file by path, in the form of ``pooch.make_registry``."""
    lines = LIST.read_text(encoding="utf-8").splitlines()
    return dict(line.split() for line in lines if not line.startswith("#"))


@cache
def published_content() -> frozenset[str]:
    """Return the SHA-256 of the content of all published files, uncompressed."""
    return frozenset(load().values())
