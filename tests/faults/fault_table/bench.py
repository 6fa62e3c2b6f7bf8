"""What a measurement gets: a folder of its own, cars, rigs and processes, all closed after it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from fault_table.drive import Drive


class Bench:
    """One measurement's tools. ``full``: make faults, not the sample of the default tests.

    ``brief``: cars whose ESC was armed before, so that a drive begins at once.
    """

    def __init__(self, folder: Path, *, full: bool = True, brief: bool = False,
                 hil: str | None = None) -> None:
        self.folder = folder
        self.full = full
        self.brief = brief
        self.hil = hil
        self._stack = ExitStack()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def drive(self, options: str = "", **more: Any) -> Drive:
        """A car in virtual time."""
        more.setdefault("brief", self.brief)
        return self._stack.enter_context(Drive(self.folder, options, **more))

    def rig(self, **options: Any) -> Any:
        """The firmware in the emulator and a host that only knows the wire."""
        from firmware_rig import Rig

        rig = Rig(None, **options)
        self._stack.callback(rig.nano.close)
        return rig

    def process_rig(self, options: str = "", **more: Any) -> Any:
        """A car for real processes: served over a pty, or the real one."""
        from fault_table.stand import HilRig, PtyRig

        made = HilRig(self.hil, self.folder) if self.hil else PtyRig(self.folder, options,
                                                                     **more)
        return self._stack.enter_context(made)
