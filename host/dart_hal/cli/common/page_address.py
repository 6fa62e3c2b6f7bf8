"""Where a page is served, and how that is told."""

from __future__ import annotations

from collections.abc import Callable
from io import StringIO
from typing import Any, TypeVar

import click

from dart_hal.car.viewers import PORT
from dart_hal.cli.common.output import console, print_json

F = TypeVar("F", bound=Callable[..., Any])


def lan_option(command: F) -> F:
    """``--lan`` and ``--port``."""
    command = click.option("--port", type=click.IntRange(0, 65535), default=PORT,
                           show_default=True, help="where it is served; 0 takes any that is free"
                           )(command)
    return click.option("--lan", is_flag=True, help="other computers and phones may open it: "
                        "prints their address, as a QR code too")(command)


def tell(urls: tuple[str, ...], lan: bool, as_json: bool) -> None:
    """Where to look; for phones, as a picture; for machines, one object at once."""
    if as_json:
        print_json({"urls": list(urls)})
        return
    for url in urls:
        console.print(url, markup=False, highlight=False, soft_wrap=True)
    if lan:
        import segno

        if "#" in urls[0]:
            console.print("whoever has this address may drive the car", style="yellow")
        picture = StringIO()
        segno.make(urls[0], micro=False).terminal(out=picture, compact=True)
        console.print(picture.getvalue(), markup=False, highlight=False, soft_wrap=True)
