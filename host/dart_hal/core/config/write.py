"""Writing the files of a car: comments stay, the old version is kept, no half file.

The new text is written beside the file and moved over it, so that a reader or
a power cut sees the old file or the new one. The previous version goes to
``history/NAME-0001.toml``, ``-0002`` and so on.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from datetime import date, datetime, time
from errno import ENOTDIR
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import msgspec
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AbstractTable, InlineTable, Item

from dart_hal.core.errors import FileTrouble
from dart_hal.core.text_file import read_text

Document = tomlkit.TOMLDocument | AbstractTable | InlineTable
Plain = Mapping[str, Any]


def as_plain(thing: msgspec.Struct) -> dict[str, Any]:
    """The tables of a file as builtin types; what is not known is left out."""
    data = _known(msgspec.to_builtins(thing, builtin_types=(datetime, date, time)))
    return {key: value for key, value in data.items() if value != []}


def _known(data: Any) -> Any:
    if isinstance(data, Mapping):
        inner = {key: _known(value) for key, value in data.items()}
        return {key: value for key, value in inner.items() if value is not None and value != {}}
    return [_known(value) for value in data] if isinstance(data, list | tuple) else data


def dump(thing: msgspec.Struct) -> str:
    """TOML text of a car, calibration or model."""
    return _merged(tomlkit.document(), as_plain(thing), {})


def merge(text: str, thing: msgspec.Struct) -> str:
    """``text`` with the values of ``thing``: comments and order stay where keys do.

    A key that the text leaves at its default is not written out.
    """
    try:
        before = as_plain(msgspec.toml.decode(text, type=type(thing)))
        document = tomlkit.parse(text)
    except (ValueError, TOMLKitError, RecursionError):
        return dump(thing)                  # a broken file has nothing worth keeping in place
    return _merged(document, as_plain(thing), before)


def save(thing: msgspec.Struct, path: Path) -> Path:
    """Write ``thing`` to ``path`` (folders are made); the old file goes to history/."""
    path.parent.mkdir(parents=True, exist_ok=True)
    old = read_text(path) if path.exists() else None
    text = dump(thing) if old is None else merge(old, thing)
    if old == text:
        return path
    if old is not None:
        keep(path)
    replace(path, text)
    return path


def check_writable(folder: Path) -> None:
    """Raise FileTrouble if a file cannot be made in ``folder``, which need not exist yet.

    A file is made and removed in the nearest folder that exists: permissions alone do not show
    a file system that is mounted read-only or full.
    """
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


def keep(path: Path) -> Path:
    """Copy a file to the next free number in history/ beside it."""
    folder = path.parent / "history"
    folder.mkdir(exist_ok=True)
    free = 1 + max((number(p) for p in folder.glob(f"{path.stem}-*{path.suffix}")), default=0)
    return Path(shutil.copy2(path, folder / f"{path.stem}-{free:04d}{path.suffix}"))


def replace(path: Path, text: str) -> None:
    """Write a file in one step: never half of it, not even after a power cut."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    with beside.open("w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)


def number(path: Path) -> int:
    """Of a version in history/; 0 for what is none."""
    tail = path.stem.rpartition("-")[2]
    return int(tail) if tail.isdigit() else 0


def _merged(document: tomlkit.TOMLDocument, data: Plain, before: Plain) -> str:
    _merge_into(document, data, before, depth=0)
    return tomlkit.dumps(document)


def _merge_into(table: Document, data: Plain, before: Plain, depth: int) -> None:
    for key in [k for k in table if k not in data]:
        del table[key]
    for key, value in data.items():
        if key in table and isinstance(value, Mapping) and isinstance(table[key], Mapping):
            _merge_into(table[key], value, before.get(key, {}), depth + 1)
        elif (_unwrapped(table[key]) if key in table else before.get(key)) != value:
            table[key] = _item(value, depth)


def _unwrapped(item: Any) -> Any:
    return item.unwrap() if isinstance(item, Item) else item


def _item(value: Any, depth: int) -> Any:
    """Top tables get a header, tables inside them one line each, effects [[...]]."""
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
