"""The walks of the code overview as data, and a tracer that sees in which order functions run."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from handbook import DOCS

OVERVIEW_PAGE = DOCS / "contributing" / "code_overview.md"
STEP_LINE = re.compile(r"^\d+\. `(dart_\w+\.[\w.]+)`", re.MULTILINE)
DOTTED_NAME = re.compile(r"`(dart_(?:hal|lab)\.\w+\.[\w.]+)`")
"""Not groups of entry points, which have one dot."""
FIRMWARE_LINE = re.compile(r"`(firmware/[\w/.]+)`,\s+`(\w+)`")
MAX_STEPS = 10


def section(heading: str) -> str:
    """Return the text below a heading of the code overview, up to the next one."""
    _, found, below = OVERVIEW_PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    assert found, f"no section {heading!r}"
    return below.partition("\n## ")[0]


def steps(heading: str) -> list[str]:
    """Return the functions of a walk in their order."""
    return STEP_LINE.findall(section(heading))


def find_object(name: str) -> Any:
    """Import a module, class, function or method by its dotted name."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
    raise LookupError(name)


def first_calls(names: Sequence[str], work: Callable[[], object]) -> list[str]:
    """Run ``work()`` and return the functions that it called, in the order of first calls."""
    waiting = {inspect.unwrap(find_object(n)).__code__: n for n in names}
    calls: list[str] = []

    def look(frame: Any, event: str, arg: object) -> None:
        if event == "call" and frame.f_code in waiting:
            calls.append(waiting.pop(frame.f_code))

    sys.setprofile(look)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls
