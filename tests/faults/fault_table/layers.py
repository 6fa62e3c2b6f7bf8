"""Every safety layer of the product, and the one line that removes it.

``without("guard")`` takes the guard away for this process and, through the
environment, for the processes that the suite starts. The switches live here
and nowhere else: the product has none. A layer of the firmware is removed by
an image that was built without it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from fault_table.broken import Change, image

VARIABLE = "FAULT_TABLE_WITHOUT"
"""Names of removed layers, for the processes of the suite."""
FOREVER = 1e9


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer: what it does, and what removes it: a patch of the host, or an image's sources."""

    name: str
    does: str
    target: str = ""
    replacement: Any = None
    changes: tuple[Change, ...] = ()


LAYERS: dict[str, Layer] = {}


def host(name: str, does: str, target: str, replacement: Any) -> None:
    """A layer of the host: ``target`` (a dotted name) becomes ``replacement``."""
    LAYERS[name] = Layer(name, does, target, replacement)


def firmware(name: str, does: str, *changes: Change) -> None:
    """A layer of the firmware: the image is built with these changes of the sources."""
    LAYERS[name] = Layer(name, does, changes=changes)


def list_removed() -> list[str]:
    """Names of the layers that are gone."""
    return [name for name in os.environ.get(VARIABLE, "").split(",") if name]


@contextmanager
def remove_layers(*names: str) -> Iterator[None]:
    """These layers are gone, here and in processes started meanwhile. Raises KeyError."""
    names_removed = list(dict.fromkeys([*list_removed(), *names]))
    lame = [LAYERS[name] for name in names_removed if LAYERS[name].changes]
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {VARIABLE: ",".join(names_removed)}))
        if lame:
            made = image("-".join(layer.name for layer in lame),
                         tuple(change for layer in lame for change in layer.changes))
            stack.enter_context(patch.dict(os.environ, DART_HAL_FIRMWARE=str(made)))
        for name in names:
            if LAYERS[name].target:
                stack.enter_context(patch(LAYERS[name].target, LAYERS[name].replacement))
        yield


def inherit() -> AbstractContextManager[None]:
    """In a process of the suite: remove what its parent has removed."""
    return remove_layers(*list_removed())
