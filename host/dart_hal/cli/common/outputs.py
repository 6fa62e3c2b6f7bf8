"""Types of options that name an output. All is checked before a verb begins its work.

One rule for what exists: recordings are kept (the old one gets a number), files of a car go to
history/, what can be computed again (pictures, pages, tables) is replaced with a notice, and a
folder with a data set is never replaced.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from dart_hal.cli.common.output import notices
from dart_hal.core.config import check_writable
from dart_hal.core.errors import FileTrouble, UsageError
from dart_hal.core.figures import FORMATS
from dart_hal.core.process.extras import install_command


class OutputFile(click.Path):
    """A file to write: its suffix, its folder and an old file of that name are checked.

    suffixes: of its name, in lower case; none: any. replaces: an old file is replaced.
    """

    def __init__(self, *suffixes: str, replaces: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=False)
        self.suffixes, self.replaces = suffixes, replaces

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            raise UsageError(f"{path} does not end in {self.suffixes[0]}", found=path.name,
                             expected=f"a name that ends in {' or '.join(self.suffixes)}",
                             remedy=f"write {path.with_suffix(self.suffixes[0])}"
                             if path.name else "name a file")
        check_writable(path.parent)
        if path.exists():
            if not os.access(path, os.W_OK):
                raise FileTrouble(f"{path} cannot be replaced", found="a file that is read-only",
                                  read=str(path), remedy="name another file")
            if self.replaces:
                notices((f"{path} is replaced",))
        return path


class PlotFile(OutputFile):
    """A picture to write; needs matplotlib."""

    def __init__(self) -> None:
        super().__init__(*FORMATS)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        check_matplotlib()
        return super().convert(value, param, ctx)


class PlotFolder(click.Path):
    """A folder for pictures, made where it does not exist; needs matplotlib."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        check_matplotlib()
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        check_writable(path)
        return path


class PlotFileOrFolder(click.Path):
    """One picture by its suffix, else a folder for all of them; needs matplotlib."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if path.suffix.lower() in FORMATS and not path.is_dir():
            return PlotFile().convert(value, param, ctx)
        if path.is_file() or (path.suffix and not path.is_dir()):
            raise UsageError(f"{path} is neither a picture nor a folder", found=path.name,
                             expected=f"a name that ends in {' or '.join(FORMATS)}, or a folder",
                             remedy=f"write {path.with_suffix(FORMATS[0])} or {path.parent}/")
        return PlotFolder().convert(value, param, ctx)


def check_matplotlib() -> None:
    """Raise UsageError without matplotlib."""
    try:
        found = find_spec("matplotlib") is not None
    except ValueError:  # it is being kept from being imported
        found = False
    if not found:
        raise UsageError("a plot needs matplotlib", found="it is not installed",
                         remedy=install_command("plot"))
