"""Write the files that are generated from ``messages.py``, and check that they are current."""

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

__all__ = ["GENERATED_FILES", "list_stale", "render_header", "render_markdown", "render_vectors",
           "write_all"]

VECTORS = "tests/wire/vectors.json"

# Functions that render the generated files, by path from the root of a checkout.
GENERATED_FILES: dict[str, Callable[[], str]] = {
    "firmware/src/core/messages.h": render_header,
    "docs/reference/wire.md": render_markdown,
    VECTORS: render_vectors,
}


def write_all(root: Path) -> list[str]:
    """Write the generated files that differ below ``root``; return their paths.

    Raises UsageError, and writes nothing, if the definitions violate a rule (two equal seeds, two
    equal ids, a payload that is too long, the seed of a definition of the checkout's version).
    """
    check(retired=(*RETIRED, *_read_previous(root)))
    stale = list_stale(root)
    for name in stale:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(GENERATED_FILES[name](), encoding="utf-8", newline="\n")
    return stale


def list_stale(root: Path) -> list[str]:
    """Return the generated files below ``root`` that are missing or not current."""
    return [name for name, render in GENERATED_FILES.items() if _read(root / name) != render()]


def _read_previous(root: Path) -> list[tuple[str, int]]:
    """Return (text, seed) of the definitions in the golden vectors below ``root``."""
    text = _read(root / VECTORS)
    try:
        return [(m["text"], m["seed"]) for m in json.loads(text or "{}").get("messages", ())]
    except (ValueError, KeyError) as error:
        raise UsageError(f"{VECTORS} is not what was generated", read=str(root / VECTORS),
                         remedy=f"git checkout {VECTORS}") from error


def _read(path: Path) -> str | None:
    return path.read_text(encoding="utf-8") if path.is_file() else None
