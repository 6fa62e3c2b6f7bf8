"""Everything that is generated from ``messages.py``, and whether it is up to date."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from dart_hal.core.errors import UsageError
from dart_hal.wire.emit_cpp import render_header
from dart_hal.wire.emit_markdown import render_markdown
from dart_hal.wire.messages import RETIRED
from dart_hal.wire.rules import check
from dart_hal.wire.vectors import render_vectors

__all__ = ["FILES", "drift", "render_header", "render_markdown", "render_vectors",
           "write_all"]

VECTORS = "tests/wire/vectors.json"

FILES: dict[str, Callable[[], str]] = {
    "firmware/src/core/messages.h": render_header,
    "docs/reference/wire.md": render_markdown,
    VECTORS: render_vectors,
}
"""Generated files below the root of a checkout."""


def write_all(root: Path) -> list[str]:
    """Write what differs below ``root``; returns those paths.

    Raises UsageError, and writes nothing, when the definitions break a rule
    (two seeds alike, an id twice, a payload too long, the seed of the version
    that stands in the checkout).
    """
    check(retired=(*RETIRED, *_previous(root)))
    stale = drift(root)
    for name in stale:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(FILES[name](), encoding="utf-8", newline="\n")
    return stale


def drift(root: Path) -> list[str]:
    """Generated files below ``root`` that are missing or not as their source says."""
    return [name for name, render in FILES.items() if _text(root / name) != render()]


def _previous(root: Path) -> list[tuple[str, int]]:
    """(text, seed) of the definitions that the vectors below ``root`` were made from."""
    text = _text(root / VECTORS)
    try:
        return [(m["text"], m["seed"]) for m in json.loads(text or "{}").get("messages", ())]
    except (ValueError, KeyError) as error:
        raise UsageError(f"{VECTORS} is not what was generated", read=str(root / VECTORS),
                         remedy=f"git checkout {VECTORS}") from error


def _text(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None
