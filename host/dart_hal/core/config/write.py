"""Write the files of a car: comments are preserved, previous versions archived.

The new text is written to a temporary file in the same folder, which then replaces the file. A
reader, also after a power cut, has either the old file or the new one, never a part of it. The
previous version is copied to ``history/NAME-0001.toml``, ``-0002`` and so on.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import date, datetime, time
from errno import ENOTDIR
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from dart_hal.core.errors import FileTrouble
from dart_hal.core.text_file import read_text

# tomlkit is imported by what writes a file: a program that drives writes none.
if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.items import AbstractTable, InlineTable

    Document = TOMLDocument | AbstractTable | InlineTable
Plain = Mapping[str, Any]


def to_tables(thing: msgspec.Struct) -> dict[str, Any]:
    """Convert a file to tables of builtin types, without unknown values and empty tables."""
    data = _drop_unknown(msgspec.to_builtins(thing, builtin_types=(datetime, date, time)))
    return {key: value for key, value in data.items() if value != []}


def _drop_unknown(data: Any) -> Any:
    """Return the data without None and empty tables."""
    if isinstance(data, Mapping):
        inner = {key: _drop_unknown(value) for key, value in data.items()}
        return {key: value for key, value in inner.items() if value is not None and value != {}}
    return [_drop_unknown(value) for value in data] if isinstance(data, list | tuple) else data


def dump(thing: msgspec.Struct) -> str:
    """Return the TOML text of a car, calibration or model."""
    import tomlkit

    return _render_merged(tomlkit.document(), to_tables(thing), {})


def merge(text: str, thing: msgspec.Struct) -> str:
    """Return ``text`` with the values of ``thing``; comments and the order of keys remain.

    A key that is absent from the text and has its default value is not added.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        previous = to_tables(msgspec.toml.decode(text, type=type(thing)))
        document = tomlkit.parse(text)
    except (ValueError, TOMLKitError, RecursionError):
        return dump(thing)  # of an invalid file nothing can be preserved
    return _render_merged(document, to_tables(thing), previous)


def save(thing: msgspec.Struct, path: Path) -> Path:
    """Write ``thing`` to ``path``, with its folders; the old file is copied to history/."""
    path.parent.mkdir(parents=True, exist_ok=True)
    old = read_text(path) if path.exists() else None
    text = dump(thing) if old is None else merge(old, thing)
    if old == text:
        return path
    if old is not None:
        archive_version(path)
    replace(path, text)
    return path


def check_writable(folder: Path) -> None:
    """Raise FileTrouble if a file cannot be made in ``folder``, which need not exist yet.

    A file is made and removed in the nearest folder that exists: permissions alone do not show
    a file system that is mounted read-only or full.
    """
    from tempfile import TemporaryFile

    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        if not existing.is_dir():
            raise NotADirectoryError(ENOTDIR, os.strerror(ENOTDIR), str(existing))
        with TemporaryFile(dir=existing) as file:
            file.write(b"0")
    except OSError as error:
        raise FileTrouble(f"{folder} cannot be written", found=f"{existing}: {error.strerror}",
                          read=str(folder), expected="a folder in which files can be made",
                          remedy="name another folder, or change its permissions") from error


def archive_version(path: Path) -> Path:
    """Copy a file to the next free number in history/ of its folder; return the copy."""
    from shutil import copy2

    folder = path.parent / "history"
    folder.mkdir(exist_ok=True)
    versions = folder.glob(f"{path.stem}-*{path.suffix}")
    free = 1 + max(map(version_number, versions), default=0)
    return Path(copy2(path, folder / f"{path.stem}-{free:04d}{path.suffix}"))


def replace(path: Path, text: str) -> None:
    """Replace a file atomically: it is complete even after a power cut."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def version_number(path: Path) -> int:
    """Return the number of a version in history/; 0 for another file."""
    tail = path.stem.rpartition("-")[2]
    return int(tail) if tail.isdigit() else 0


def _render_merged(document: TOMLDocument, data: Plain, previous: Plain) -> str:
    import tomlkit

    _merge_into(document, data, previous, depth=0)
    return tomlkit.dumps(document)


def _merge_into(table: Document, data: Plain, previous: Plain, depth: int) -> None:
    """Change the entries of ``table`` that differ from ``data``; the others keep their comments.

    previous: the data of the old text, with the defaults of absent keys.
    """
    # Keys that are absent from the data are deleted; an unchanged value is not touched, because
    # a new item would have no comment.
    for key in [k for k in table if k not in data]:
        del table[key]
    for key, value in data.items():
        if key in table and isinstance(value, Mapping) and isinstance(table[key], Mapping):
            _merge_into(table[key], value, previous.get(key, {}), depth + 1)
        elif (_unwrap(table[key]) if key in table else previous.get(key)) != value:
            table[key] = _item(value, depth)


def _unwrap(item: Any) -> Any:
    from tomlkit.items import Item

    return item.unwrap() if isinstance(item, Item) else item


def _item(value: Any, depth: int) -> Any:
    """Convert a value: a top table has a header, a table inside it one line, effects [[...]]."""
    import tomlkit

    if isinstance(value, Mapping) and depth == 0:
        table = tomlkit.table()
        for key, inner in value.items():
            table[key] = _item(inner, depth + 1)
        return table
    if isinstance(value, Mapping):
        inline = tomlkit.inline_table()
        inline.update({key: _item(inner, depth + 1) for key, inner in value.items()})
        return inline
    if depth == 0 and isinstance(value, list) and value and isinstance(value[0], Mapping):
        rows = tomlkit.aot()
        for row in value:
            rows.append(_item(row, depth=0))
        return rows
    return value
