"""Electrical check of the harness: every car that can be built, every supply on and off.

    python hardware/wiring/electrical.py       one line per fault; exit 1 if there is one

A fault names its rule, the pins, what was found, what was expected, and the car and the supplies
for which it was found first. What each pin gives and takes stands in electrical.yml.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from harness import HERE, WiringError
from nets import Car, Harness
from rules import RULES
from supply import State, supplied

PULLED = "W_USB"
"""The cable whose end at the computer comes out in use; it may carry the Nano's only ground."""
NEVER = "UNPOWERED"
"""Name of the fault that only all states together show."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One broken rule. ``where``: pins; ``case``: the first car and state that shows it."""

    rule: str
    where: str
    found: str
    expected: str
    case: str

    def __str__(self) -> str:
        """One line for the one who drew it."""
        return f"{self.rule}: {self.where}: {self.found}; expected {self.expected} [{self.case}]"


def states(car: Car, harness: Harness) -> Iterator[tuple[str, State]]:
    """Every combination of supplies, in words; both with the Nano's USB cable and without."""
    for without in ("", PULLED):
        c = harness.circuit(car, without)
        switches = sorted({c.pins[n].switch for n in c.net
                           if n in c.pins and c.pins[n].kind == "battery"})
        for bits in product((False, True), repeat=len(switches)):
            on = frozenset(s for s, bit in zip(switches, bits, strict=True) if bit)
            words = [f"{s} {'on' if s in on else 'off'}" for s in switches]
            if without:
                words.append("Nano's USB cable out")
            yield ", ".join(words), supplied(c, on, bool(without))


def judge(car: Car, harness: Harness) -> list[Fault]:
    """Faults of one car, each once. Raises WiringError."""
    found: dict[tuple[str, str], Fault] = {}
    dead: set[str] | None = None
    for words, state in states(car, harness):
        for rule, look in RULES.items():
            for where, what, expected in look(state):
                found.setdefault((rule, where),
                                 Fault(rule, where, what, expected, f"{car}; {words}"))
        off = {name for name, _, net in state.circuit.of("load") if net not in state.live}
        dead = off if dead is None else dead & off
    return [*found.values(),
            *(Fault(NEVER, name, "no supply reaches it", "one that can be switched on", str(car))
              for name in sorted(dead or ()))]


def check(folder: Path = HERE) -> list[Fault]:
    """Faults of every car, each once. Raises WiringError."""
    found: dict[tuple[str, str], Fault] = {}
    harness = Harness(folder)
    for car in harness.cars():
        for fault in judge(car, harness):
            found.setdefault((fault.rule, fault.where), fault)
    return list(found.values())


def main() -> int:
    """Print every fault."""
    try:
        faults = check()
    except WiringError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    if not faults:
        count = sum(1 for _ in Harness().cars())
        sys.stdout.write(f"{count} cars, each with every supply on and off: no fault\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
