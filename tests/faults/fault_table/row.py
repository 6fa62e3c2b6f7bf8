"""What a row of the fault table is: a fault, its limit, how it is measured, and its control.

A case measures one fault in one world. Its control is the same measurement
with one safety layer (or the named few) removed: it must break the limit, or
the measurement proves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fault_table.bench import Bench

NEVER = math.inf
"""The fault was never answered."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What a case came to, in the unit of its limit; ``detail``: what else was observed."""

    value: float
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One measurement. ``limit`` in ``unit``; ``control``: layers without which it fails.

    ``world``: wire (bytes alone), mock, elf (virtual time), pty (real
    processes in real time). ``fast``: part of the default tests. ``hil``: makes
    sense on a real car with lifted wheels.
    """

    world: str
    what: str
    measure: Callable[[Bench], Measured]
    limit: float
    unit: str
    control: tuple[str, ...]
    fast: bool = False
    hil: bool = False

    def holds(self, measured: Measured) -> bool:
        """Whether the figure keeps the limit; nan never does."""
        return measured.value <= self.limit


@dataclass(frozen=True, slots=True)
class Row:
    """One fault of the table and what must come of it."""

    number: int
    fault: str
    reaction: str
    cases: tuple[Case, ...]


def case(world: str, what: str, measure: Callable[[Bench], Measured], limit: float, unit: str,
         *control: str, fast: bool = False, hil: bool = False) -> Case:
    """A case as the rows write it: the layers of its control come last."""
    return Case(world, what, measure, limit, unit, control, fast, hil)
