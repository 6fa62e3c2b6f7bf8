"""Published files in a folder or an archive of any layout, found by checksum."""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from dart_hal.errors import FetchFailed

ENDINGS, PACKED = (".csv", ".csv.gz"), ".gz"
LARGEST = 1 << 28  # bytes; no recording is that long, so it is not read


class Local:
    """A downloader for pooch that copies out of a folder or an archive.

    registry: SHA-256 by path. A file is found by its checksum, else by its name
    (which pooch then refuses). Errors: FetchFailed when an archive is damaged.
    """

    def __init__(self, path: Path, name: str, registry: Mapping[str, str]) -> None:
        self.name = self.where = name
        self._found: dict[str, tuple[str, bytes]] = {}
        wanted = {*registry.values(), *map(_base, registry)}
        try:
            for entry, data in _entries(path):
                content = _content(entry, data)
                for key in (sha256(content).hexdigest(), _base(entry.removesuffix(PACKED))):
                    if key in wanted:
                        self._found.setdefault(key, (entry, content))
        except (zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, gzip.BadGzipFile,
                RuntimeError) as err:  # RuntimeError: a password, or a method unknown here
            raise FetchFailed(f"{name}: not a whole archive", found=f"{type(err).__name__}: {err}",
                              expected="a .zip or .tar.gz of the repository", read=str(path),
                              likely="a download that was cut off, a web page saved as a file, or "
                                     "an archive with a password",
                              remedy="download it again") from err

    def __call__(self, path: str, to: str, store: Any) -> None:
        """Write the file of that path to ``to``. Raises LookupError when there is none."""
        key = store.registry[path]
        self.where, content = self._found[key if key in self._found else _base(path)]
        Path(to).write_bytes(content)


def _base(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def _entries(path: Path) -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of every file below a folder, or in an archive, that may be a recording."""
    if path.is_dir():
        for file in sorted(path.rglob("*")):
            if file.name.endswith(ENDINGS) and file.is_file() and file.stat().st_size <= LARGEST:
                yield file.as_posix(), file.read_bytes()
    elif zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as packed:
            for info in packed.infolist():
                if info.filename.endswith(ENDINGS) and info.file_size <= LARGEST:
                    yield info.filename, packed.read(info)
    else:
        with tarfile.open(path) as tape:
            for member in tape:
                handle = tape.extractfile(member) if member.isfile() else None
                if handle and member.name.endswith(ENDINGS) and member.size <= LARGEST:
                    yield member.name, handle.read()


def _content(entry: str, data: bytes) -> bytes:
    """Unpacked bytes; a damaged pack gives what it is, which no checksum fits."""
    if entry.endswith(PACKED):
        try:
            with gzip.open(io.BytesIO(data)) as unpacked:
                return unpacked.read(LARGEST)
        except (OSError, EOFError, zlib.error):
            return data
    return data
