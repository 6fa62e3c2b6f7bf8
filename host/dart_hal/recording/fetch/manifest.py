"""The list of the published recordings: path, size and SHA-256 of each.

``published.json`` is made by ``from_folder`` out of a folder of originals:

    python -c "from dart_hal.recording.fetch import manifest as m; \\
               m.write(m.from_folder('FOLDER'), m.OURS)"
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dart_hal.errors import RecordingError

OURS = Path(__file__).with_name("published.json")
NOTICE = Path(__file__).with_name("LICENSE")
SCHEMA = "dart-hal/recordings/1"
REPOSITORY = "https://github.com/Lorenzo-Lyons/DART"
COMMIT = "7c30162"
ROOTS = ("System_identification/Data", "ROS_packages/racecar_pkg/src/Data")


@dataclass(frozen=True, slots=True)
class Published:
    """One file: ``path`` below its root folder, size [bytes], SHA-256 in hex."""

    path: str
    size: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """Files of a published set; ``roots`` are the repository folders that hold them."""

    repository: str
    commit: str
    roots: tuple[str, ...]
    files: tuple[Published, ...]

    @property
    def size(self) -> int:
        """All files together [bytes]."""
        return sum(f.size for f in self.files)


def sha256(data: bytes) -> str:
    """Digest in hex."""
    return hashlib.sha256(data).hexdigest()


def from_folder(folder: str | Path) -> Manifest:
    """The manifest of every ``*.csv`` below ``folder``, in name order."""
    root = Path(folder)
    files = []
    for path in sorted(root.rglob("*.csv")):
        data = path.read_bytes()
        files.append(Published(path.relative_to(root).as_posix(), len(data), sha256(data)))
    return Manifest(REPOSITORY, COMMIT, ROOTS, tuple(files))


def load(path: str | Path = OURS) -> Manifest:
    """Read a manifest. Errors: RecordingError when it is damaged."""
    try:
        table: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
        files = tuple(Published(f["path"], int(f["size"]), f["sha256"]) for f in table["files"])
        return Manifest(table["repository"], table["commit"], tuple(table["roots"]), files)
    except (OSError, ValueError, KeyError, TypeError) as err:
        raise RecordingError(f"{path}: the list of published recordings cannot be read",
                             found=f"{type(err).__name__}: {err}", expected=SCHEMA,
                             read=str(path), remedy="install dart-hal again") from err


def write(manifest: Manifest, path: str | Path) -> None:
    """Write a manifest as JSON, one file per line."""
    head = {"schema": SCHEMA, "repository": manifest.repository, "commit": manifest.commit,
            "roots": list(manifest.roots)}
    lines = [json.dumps({"path": f.path, "size": f.size, "sha256": f.sha256})
             for f in manifest.files]
    files = ',\n "files": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n"
    Path(path).write_text(json.dumps(head, indent=1)[:-2] + files, encoding="utf-8")
