"""Where verbs print: JSON and results to standard output, all that is beside them to the other."""

from __future__ import annotations

import json
import os
import sys
from typing import IO, Any, cast

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from dart_hal.core.plain_json import plain


class _Output:
    """Standard output as it is now, and nowhere once its reader has enough, as `| head` does:
    what is left to do, pictures or a car that must be stopped, is done all the same."""

    def write(self, text: str) -> int:
        try:
            return sys.stdout.write(text)
        except BrokenPipeError:
            self._stop()
            return len(text)

    def flush(self) -> None:
        try:
            sys.stdout.flush()
        except BrokenPipeError:
            self._stop()

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stdout, name)

    def _stop(self) -> None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


output = cast("IO[str]", _Output())
console = Console(stderr=True, soft_wrap=True, emoji=False)
"""Notices and progress: never mixed into what is asked for."""
results = Console(file=output, soft_wrap=True, emoji=False)
"""What was asked for, where it is not asked for as JSON: to be read, kept or searched."""


def say(text: str, style: str | None = None) -> None:
    """One line of what was asked for, as it is: no markup, no colours but ``style``."""
    results.print(text, style=style, markup=False, highlight=False)


def print_json(value: Any) -> None:
    """Print exactly one JSON object on standard output."""
    print(json.dumps(plain(value), indent=2, allow_nan=False), file=output, flush=True)


def notices(lines: tuple[str, ...]) -> None:
    """Show sentences that the user must see once."""
    for line in lines:
        console.print(f"notice: {line}", style="yellow", markup=False, highlight=False)


def progress_bar() -> Progress:
    """Progress on standard error, gone when it is done."""
    return Progress(TextColumn("{task.description}"), BarColumn(),
                    TextColumn("{task.percentage:>3.0f}%"), TimeRemainingColumn(),
                    console=console, transient=True)
