"""Where a file of the published set may come from: a folder, an archive, a web address.

A source gives bytes or says why not; whether they are right is the caller's
check, by SHA-256, whatever the source.
"""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

from dart_hal.errors import FetchFailed

from .manifest import Published, sha256

ARCHIVES = (".zip", ".tar.gz", ".tgz", ".tar")
PACKED = ".gz"
LARGEST = 1 << 28  # bytes; no recording is that long, so it is not read


class Offer(NamedTuple):
    """What a source has for one file: ``data`` None = nothing; ``where`` for messages."""

    data: bytes | None
    where: str


class Source(Protocol):
    """Anything that may hold published files."""

    name: str

    def get(self, wanted: Published) -> Offer:
        """The file, a wrong file of the same name, or nothing. Errors: FetchFailed."""
        ...


class _Entry(NamedTuple):
    name: str
    size: int
    read: Callable[[], bytes]


class Index:
    """Files of any layout, found by checksum, else by name (then the caller refuses them)."""

    def __init__(self, name: str, entries: Iterator[_Entry]) -> None:
        self.name = name
        self._by_size: dict[int, list[_Entry]] = {}
        self._packed: list[_Entry] = []
        self._by_name: dict[str, _Entry] = {}
        for entry in entries:
            base = entry.name.rsplit("/", 1)[-1]
            self._by_name.setdefault(base.removesuffix(PACKED), entry)
            if base.endswith(PACKED):
                self._packed.append(entry)
            else:
                self._by_size.setdefault(entry.size, []).append(entry)
        self._unpacked: dict[str, _Entry] | None = None

    def get(self, wanted: Published) -> Offer:
        """By checksum among the files of its size, then among packed ones, then by name."""
        for entry in self._by_size.get(wanted.size, ()):
            data = entry.read()
            if sha256(data) == wanted.sha256:
                return Offer(data, entry.name)
        if self._unpacked is None:
            self._unpacked = {sha256(_content(e)): e for e in self._packed}
        packed = self._unpacked.get(wanted.sha256)
        if packed is not None:
            return Offer(_content(packed), packed.name)
        other = self._by_name.get(wanted.path.rsplit("/", 1)[-1])
        if other is None or other.size > LARGEST:
            return Offer(None, self.name)
        return Offer(_content(other), other.name)


def _content(entry: _Entry) -> bytes:
    """Unpacked bytes; a damaged pack gives what it is, which no checksum fits."""
    data = entry.read()
    if entry.name.endswith(PACKED):
        try:
            with gzip.open(io.BytesIO(data)) as unpacked:
                return unpacked.read(LARGEST)
        except (OSError, EOFError, zlib.error):
            return data
    return data


def folder(path: Path) -> Index:
    """Every file below ``path`` whose name ends in .csv or .csv.gz."""
    def entries() -> Iterator[_Entry]:
        for file in sorted(path.rglob("*")):
            if file.name.endswith((".csv", ".csv.gz")) and file.is_file():
                yield _Entry(file.as_posix(), file.stat().st_size, file.read_bytes)

    return Index(str(path), entries())


@contextmanager
def archive(path: Path, name: str) -> Iterator[Index]:
    """Members of a .zip or .tar.gz, open while the source is used.

    Errors: FetchFailed when it is no archive or damaged.
    """
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as packed:
                yield Index(name, _zip_entries(packed))
        else:
            with tarfile.open(path) as tape:
                yield Index(name, _tar_entries(tape))
    except (zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, gzip.BadGzipFile,
            _CannotUnpack) as err:
        raise FetchFailed(f"{name}: not a whole archive", found=f"{type(err).__name__}: {err}",
                          expected="a .zip or .tar.gz of the repository", read=str(path),
                          likely="a download that was cut off, a web page saved as a file, or an "
                                 "archive with a password",
                          remedy="download it again") from err


def _zip_entries(packed: zipfile.ZipFile) -> Iterator[_Entry]:
    for info in packed.infolist():
        if not info.is_dir() and info.file_size <= LARGEST:
            yield _Entry(info.filename, info.file_size, lambda i=info: _unzipped(packed, i))  # type: ignore[misc]


class _CannotUnpack(Exception):
    """Encrypted, or packed in a way that this Python does not know."""


def _unzipped(packed: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    try:
        return packed.read(info)
    except (RuntimeError, NotImplementedError) as err:
        raise _CannotUnpack(str(err)) from err


def _tar_entries(tape: tarfile.TarFile) -> Iterator[_Entry]:
    for info in tape.getmembers():
        if info.isfile() and info.size <= LARGEST:
            yield _Entry(info.name, info.size, lambda i=info: _member(tape, i))  # type: ignore[misc]


def _member(tape: tarfile.TarFile, info: tarfile.TarInfo) -> bytes:
    handle = tape.extractfile(info)
    return handle.read() if handle is not None else b""
