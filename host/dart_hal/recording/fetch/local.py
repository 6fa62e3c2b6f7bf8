"""Published files in a folder or an archive of any layout, found by checksum."""

from __future__ import annotations

import bz2
import gzip
import lzma
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from math import inf
from pathlib import Path
from typing import IO, Any, cast

from dart_hal.core.errors import FetchFailed
from dart_hal.recording.expansion import (
    MAX_RATIO,
    ExpandsTooFar,
    LimitedStream,
    expand_gzip,
    expansion_limit,
)

RECORDING_SUFFIXES = (".csv", ".csv.gz")
GZIP_SUFFIX = ".gz"
MAX_FILE_SIZE = 1 << 28  # bytes; larger files are no recordings and not read
_OPENERS: dict[bytes, Callable[[IO[bytes]], IO[bytes]]] = {
    b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ\0": lzma.open}  # type: ignore[dict-item]


class Local:
    """A downloader for pooch that copies from a folder or an archive.

    registry: SHA-256 by path. A file is found by its checksum, else by its name (pooch then refuses
    it). Errors: FetchFailed for a damaged archive.
    """

    def __init__(self, path: Path, name: str, registry: Mapping[str, str]) -> None:
        self.name = self.where = name
        self._found: dict[str, tuple[str, bytes]] = {}
        keys = {*registry.values(), *map(_base, registry)}
        try:
            rest = inf if path.is_dir() else expansion_limit(path.stat().st_size)
            for entry, data in _entries(path):
                content = _content(entry, data, rest)
                rest -= len(content)
                for key in (sha256(content).hexdigest(), _base(entry.removesuffix(GZIP_SUFFIX))):
                    if key in keys:
                        self._found.setdefault(key, (entry, content))
                if rest < 0:
                    length = path.stat().st_size
                    raise ExpandsTooFar(length, expansion_limit(length))
        except ExpandsTooFar as err:
            raise FetchFailed(f"{name}: the archive expands too far", found=str(err),
                              expected=f"at most {MAX_RATIO} bytes for each byte of the archive",
                              read=str(path), likely="an archive that was made to fill the memory",
                              remedy="download it again, or unpack it and name the folder"
                              ) from err
        except (zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, EOFError,
                OSError, ValueError, RuntimeError) as err:
            # RuntimeError: a password, or a method unknown here. OSError without a number: a
            # damaged archive
            if isinstance(err, OSError) and err.errno is not None:
                raise FetchFailed(f"{name}: cannot be read", found=err.strerror or str(err),
                                  expected="a file or a folder that this user may read",
                                  read=str(path), remedy="check the path") from err
            raise FetchFailed(f"{name}: not a whole archive", found=f"{type(err).__name__}: {err}",
                              expected="a .zip or .tar.gz of the repository", read=str(path),
                              likely="a download that was cut off, a web page saved as a file, or "
                                     "an archive with a password",
                              remedy="download it again") from err

    def __call__(self, path: str, destination: str, store: Any) -> None:
        """Write the file of a path to ``destination``. Raises LookupError if there is none."""
        key = store.registry[path]
        self.where, content = self._found[key if key in self._found else _base(path)]
        Path(destination).write_bytes(content)


def _base(name: str) -> str:
    return name.rsplit("/", 1)[-1]


def _entries(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield (name, bytes) of each possible recording below a folder or in an archive."""
    if path.is_dir():
        for file in sorted(path.rglob("*")):
            if (file.name.endswith(RECORDING_SUFFIXES) and file.is_file()
                    and file.stat().st_size <= MAX_FILE_SIZE):
                yield file.as_posix(), file.read_bytes()
    elif zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as packed:
            for info in packed.infolist():
                if info.filename.endswith(RECORDING_SUFFIXES) and info.file_size <= MAX_FILE_SIZE:
                    if info.file_size > expansion_limit(info.compress_size):
                        raise ExpandsTooFar(info.compress_size,
                                            expansion_limit(info.compress_size))
                    yield info.filename, packed.read(info)
    else:
        with path.open("rb") as archive, _open_tar(archive, path.stat().st_size) as stream, \
                tarfile.open(fileobj=stream, mode="r|") as tape:
            for member in tape:
                handle = tape.extractfile(member) if member.isfile() else None
                if (handle and member.name.endswith(RECORDING_SUFFIXES)
                        and member.size <= MAX_FILE_SIZE):
                    yield member.name, handle.read()


def _open_tar(file: IO[bytes], length: int) -> IO[bytes]:
    """Open a tar archive that is packed by gzip, bzip2, xz or not at all."""
    magic = file.read(6)
    file.seek(0)
    for start, opener in _OPENERS.items():
        if magic.startswith(start):
            return cast("IO[bytes]", LimitedStream(opener(file), length))
    return file


def _content(entry: str, data: bytes, rest: float) -> bytes:
    """Unpack at most ``rest`` bytes; return a damaged pack unchanged, its checksum is wrong."""
    if entry.endswith(GZIP_SUFFIX):
        try:
            return expand_gzip(data, int(min(rest, expansion_limit(len(data)))))
        except (OSError, EOFError, zlib.error):
            return data
    return data
