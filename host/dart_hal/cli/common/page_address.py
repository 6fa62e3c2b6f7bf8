"""Options and output of the address at which a page is served."""

from __future__ import annotations

from collections.abc import Callable
from io import StringIO
from typing import Any, TypeVar

import click

from dart_hal.car.viewers import VIEWER_PORT
from dart_hal.cli.common.output import console, print_json
from dart_hal.core.process.extras import install_command

CommandT = TypeVar("CommandT", bound=Callable[..., Any])


def lan_option(command: CommandT) -> CommandT:
    """Add ``--lan`` and ``--port``: where a page is served."""
    command = click.option("--port", type=click.IntRange(0, 65535), default=VIEWER_PORT,
                           show_default=True, help="TCP port of the page; 0: any free one")(command)
    return click.option("--lan", is_flag=True, help="allow other computers and phones to open the "
                                                    "page; "
                        "prints the address for them, also as a QR code")(command)


def print_page_address(urls: tuple[str, ...], lan: bool, as_json: bool) -> None:
    """Print the addresses of a page; with lan also as a QR code, with as_json as one object.

    The code needs the package segno; without it, a line names the command that installs it.
    """
    if as_json:
        print_json({"urls": list(urls)})
        return
    for url in urls:
        console.print(url, markup=False, highlight=False, soft_wrap=True)
    if lan:
        if "#" in urls[0]:
            console.print("everyone with this address can drive the car", style="yellow")
        try:
            import segno
        except ImportError:
            console.print(f"a QR code of it needs segno: {install_command('segno')}", markup=False,
                          highlight=False, soft_wrap=True)
            return
        code = StringIO()
        segno.make(urls[0], micro=False).terminal(out=code, compact=True)
        console.print(code.getvalue(), markup=False, highlight=False, soft_wrap=True)
