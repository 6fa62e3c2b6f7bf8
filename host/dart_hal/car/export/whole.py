"""Exports are written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory


@contextmanager
def whole(out: Path) -> Iterator[Path]:
    """Yield a temporary path of the same name, file or folder, that becomes ``out`` at the end.

    An existing file is replaced. Raises OSError.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
        part = Path(folder) / out.name
        yield part
        part.replace(out)
