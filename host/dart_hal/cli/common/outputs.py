"""Types of options that name an output file. They are checked before a verb begins its work.

Rules for files that exist:

1. A recording is kept: the old one gets a number. An import is replaced: its log gives it again.
2. Files of a car are kept in history/.
3. Pictures, pages and tables can be computed again: they are replaced, with a notice.
4. A folder with a data set is never replaced.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import click

from dart_hal.cli.common.output import show_notices
from dart_hal.core.config import check_writable
from dart_hal.core.errors import FileTrouble, UsageError
from dart_hal.core.figures import FIGURE_FORMATS
from dart_hal.core.process.extras import install_command


class OutputFile(click.Path):
    """Path of a file to write; checks its suffix, its folder and an existing file.

    suffixes: allowed ones, in lower case; none: any. replaces: an existing file is replaced.
    """

    def __init__(self, *suffixes: str, replaces: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=False)
        self.suffixes = suffixes
        self.replaces = replaces

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
                raise FileTrouble(f"{path} cannot be replaced", found="a read-only file",
                                  read=str(path), remedy="name another file")
            if self.replaces:
                show_notices((f"{path} exists: it is replaced if the command succeeds",))
        return path


class PlotFile(OutputFile):
    """Path of a picture to write; needs matplotlib."""

    def __init__(self) -> None:
        super().__init__(*FIGURE_FORMATS)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        check_matplotlib()
        return super().convert(value, param, ctx)


class OutputFolder(click.Path):
    """Path of a folder for several files; checks that it can be written."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        check_writable(path)
        if path.is_dir() and any(path.iterdir()):
            show_notices((f"files in {path} of the same names are replaced",))
        return path


class PlotFolder(OutputFolder):
    """Path of a folder for pictures, created if it does not exist; needs matplotlib."""

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        check_matplotlib()
        return super().convert(value, param, ctx)


class PlotFileOrFolder(click.Path):
    """Path of one picture if it has such a suffix; needs matplotlib.

    Else it is a folder for all pictures, as in version 0.1, with a notice.
    """

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if path.suffix.lower() in FIGURE_FORMATS and not path.is_dir():
            return PlotFile().convert(value, param, ctx)
        if path.is_file() or (path.suffix and not path.is_dir()):
            suffixes = " or ".join(FIGURE_FORMATS)
            raise UsageError(f"{path} is neither a picture nor a folder", found=path.name,
                             expected=f"a name that ends in {suffixes}, or a folder",
                             remedy=f"write {path.with_suffix(FIGURE_FORMATS[0])} "
                                    f"or {path.parent}/")
        show_notices((f"--plot takes a file; write --plots {path} for a folder of pictures",))
        return PlotFolder().convert(value, param, ctx)


def check_matplotlib() -> None:
    """Raise UsageError without matplotlib."""
    try:
        found = find_spec("matplotlib") is not None
    except ValueError:
        # Raised if sys.modules holds a module without a spec, such as None for a blocked import.
        found = False
    if not found:
        raise UsageError("a plot needs matplotlib", found="it is not installed",
                         remedy=install_command("plot"))
