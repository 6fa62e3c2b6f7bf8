"""Output of verbs: JSON and results go to standard output, notices and progress to the error."""

from __future__ import annotations

import json
import os
import sys
from typing import IO, Any, cast

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from dart_hal.core.plain_json import plain

CTRL_C_STATUS = 130  # exit status after Ctrl-C, as in shells: 128 + SIGINT


class StandardOutput:
    """Writes to the current standard output, and to nowhere after its reader has closed it.

    A reader such as ``| head`` closes the pipe early. The verb still has to finish its work, such
    as stopping a car, so the broken pipe is no error.
    """

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
        """Send all further output to nowhere."""
        # At the level of the file descriptor, so that the flush at exit succeeds, too.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


output = cast("IO[str]", StandardOutput())
# Notices and progress, on standard error: never mixed with results.
console = Console(stderr=True, soft_wrap=True, emoji=False)
# Results as text, on standard output, for verbs without --json.
results = Console(file=output, soft_wrap=True, emoji=False)


def print_line(text: str, style: str | None = None) -> None:
    """Print one line of the result as it is: no markup, no colours except ``style``."""
    results.print(text, style=style, markup=False, highlight=False)


def print_verdict(verdict: str, figures: str, first: str, style: str = "bold") -> None:
    """Print the beginning of a report, a line each: verdict, figures, the first thing to do.

    verdict: a sentence with its decisive figure. An empty line is left out.
    """
    print_line(verdict, style=style)
    if figures:
        print_line(figures)
    if first:
        print_line(f"First: {first}")


def print_json(value: Any) -> None:
    """Print exactly one JSON object on standard output."""
    print(json.dumps(plain(value), indent=2, allow_nan=False), file=output, flush=True)


def show_notices(lines: tuple[str, ...]) -> None:
    """Print notices for the user on standard error."""
    for line in lines:
        console.print(f"notice: {line}", style="yellow", markup=False, highlight=False)


def count_notices(lines: tuple[str, ...], full: bool) -> None:
    """Print the number of notices on standard error, or with ``full`` each of them."""
    if full:
        show_notices(lines)
    elif lines:
        s = "" if len(lines) == 1 else "s"
        console.print(f"{len(lines)} notice{s} (--full)", style="yellow", markup=False,
                      highlight=False)


def progress_bar() -> Progress:
    """Return a progress bar on standard error that disappears at its end.

    Without a terminal there is none: it would leave an empty line.
    """
    return Progress(TextColumn("{task.description}"), BarColumn(),
                    TextColumn("{task.percentage:>3.0f}%"), TimeRemainingColumn(),
                    console=console, transient=True,
                    disable=not console.is_terminal)
