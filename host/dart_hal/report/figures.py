"""Pictures as files: one check of the library and the suffix, one way to save."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dart_hal.errors import UsageError

FORMATS = (".png", ".svg", ".pdf")


def new_figure(size: tuple[float, float], path: str | Path | None = None) -> Any:
    """An empty figure of ``size`` [inch], for ``path`` where it is known.

    Errors: UsageError when matplotlib is missing or the suffix is unknown.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as err:
        raise UsageError("a plot needs matplotlib", remedy="pip install 'dart-hal[plot]'") from err
    if path is not None and Path(path).suffix.lower() not in FORMATS:
        raise UsageError(f"no plot format {Path(path).suffix!r}", expected=", ".join(FORMATS))
    return Figure(figsize=size, layout="constrained")


def save_figure(figure: Any, path: str | Path) -> Path:
    """Write the figure; folders are made, the suffix picks the format."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path
