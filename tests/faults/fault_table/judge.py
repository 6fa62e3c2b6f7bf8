"""Runs cases: the measurement, and the same one without its layer."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from fault_table.bench import Bench
from fault_table.layers import remove_layers
from fault_table.row import Case, Measured


@dataclass(frozen=True, slots=True)
class Verdict:
    """``measured`` with every layer, ``control`` without its layer (None = not run)."""

    case: Case
    measured: Measured
    control: Measured | None
    seconds: float

    @property
    def holds(self) -> bool:
        return self.case.holds(self.measured)

    @property
    def proves(self) -> bool:
        """Whether the control was measured and broke the limit."""
        return self.control is None or self.control.value > self.case.limit

    @property
    def is_green(self) -> bool:
        return self.holds and self.proves


@dataclass(frozen=True, slots=True)
class How:
    """``removed``: layers taken away from every case; ``hil``: the URL of a real car."""

    full: bool = True
    removed: tuple[str, ...] = ()
    hil: str | None = None
    controls: bool = True


def measure_case(case: Case, how: How, *more: str) -> Measured:
    """The figure; a measurement that breaks down is NEVER, with the reason."""
    full = how.full and not more    # what no layer stops shows in a sample
    with ExitStack() as stack:
        try:
            stack.enter_context(remove_layers(*how.removed, *more))
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="fault-"))
            bench = stack.enter_context(
                Bench(Path(folder), full=full, brief=not how.full, hil=how.hil))
            return case.measure(bench)
        except Exception as error:  # noqa: BLE001 - on any failure the row is red and reports it
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            return Measured(float("nan"), reason[:300])


def judge(case: Case, how: How) -> Verdict:
    """The case and its control; layers removed for all make controls meaningless."""
    begin = time.monotonic()
    found = measure_case(case, how)
    control = None
    if how.controls and not how.removed and not how.hil:
        control = measure_case(case, how, *case.control)
    return Verdict(case, found, control, time.monotonic() - begin)


