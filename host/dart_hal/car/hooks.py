"""Hooks that watch or change the bytes between Car and backend.

A hook gets ``(direction, data, t)`` and returns the bytes to go on with: "rx" from the Nano, "tx"
to it. Fault injection and recordings use them; the recording gets the bytes after the hooks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dart_hal.core.types import Applied

Hook = Callable[[str, bytes, float], bytes]


class TrafficWriter(Protocol):
    """Methods of a run writer that the engine calls (``recording.RunWriter``)."""

    def rx(self, data: bytes, t: float) -> None: ...
    def tx(self, data: bytes, t: float) -> None: ...
    def applied(self, t: float, applied: Applied) -> None: ...


class Hooks:
    """The chain of hooks, then the writer."""

    def __init__(self) -> None:
        self._hooks: list[Hook] = []
        self.writer: TrafficWriter | None = None

    def add(self, hook: Hook) -> None:
        """Add a hook behind the others."""
        self._hooks.append(hook)

    def rx(self, data: bytes, t: float) -> bytes:
        """Pass bytes from the Nano through the hooks, and record them."""
        for hook in self._hooks:
            data = hook("rx", data, t)
        if self.writer is not None and data:
            self.writer.rx(data, t)
        return data

    def tx(self, data: bytes, t: float) -> bytes:
        """Pass bytes to the Nano through the hooks, and record them."""
        for hook in self._hooks:
            data = hook("tx", data, t)
        if self.writer is not None and data:
            self.writer.tx(data, t)
        return data
