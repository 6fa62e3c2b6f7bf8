"""An export is there as a whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory


@contextmanager
def whole(out: Path) -> Iterator[Path]:
    """A path of the same name to write to, file or folder; it becomes ``out`` at the end.

    A file that is there is replaced. Raises OSError.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
        part = Path(folder) / out.name
        yield part
        part.replace(out)
