"""Every net of a car as a Markdown table: voltage, direction, and what it carries at most."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from harness import HERE
from nets import Car, Harness
from power_tree import SHOWN, everything_on
from supply import State, drawn, span

FROM = ("battery", "source", "output", "open")
TO = ("load", "input")


def net_table(_: str, folder: Path = HERE, car: Car = SHOWN) -> str:
    """Rows: supplies by voltage, then signals. Raises WiringError."""
    state = everything_on(Harness(folder), car)
    rows = sorted({row for net in state.circuit.on for row in _row(state, net)})
    head = ["| from | to | voltage | current |", "|---|---|---|---|"]
    return "\n".join(head + [f"| {' | '.join(row[1:])} |" for row in rows])


def _row(state: State, net: str) -> Iterator[tuple[str, ...]]:
    """A supply or a signal; what has no direction (ground, USB data, motor) gives none."""
    c = state.circuit
    pins = {name: c.pins[name] for name in sorted(c.on[net]) if name in c.pins}
    given = [n for n, p in pins.items() if p.kind in FROM]
    taken = [n for n, p in pins.items() if p.kind in TO]
    buses = [n for n, p in pins.items() if p.kind == "bus"]
    if net in state.live and given:
        limit = min(pins[n].amps for n in given)
        yield ("1", _named(given), _named(taken), span(state.live[net]),
               f"{drawn(state, net):.3g} of {limit:g} A")
    elif buses:
        highest = max(pins[n].gives for n in buses)
        yield "3", _named(buses[:1]), _named(buses[1:]), f"{span(highest)}, both ways", ""
    elif given or taken:
        volts = [pins[n].gives for n in given if pins[n].gives[1]]
        far = [x for a, b, _ in c.resistors for near, x in ((a, b), (b, a)) if near == net]
        behind = [n for x in far for n in c.on.get(x, ()) if n in c.pins
                  and c.pins[n].kind in (TO if given else FROM) and c.pins[n].kind != "battery"
                  and x not in state.live]
        ends = (given, taken + behind) if given else (behind, taken)
        if given and all(ends):
            level = f"high {span(volts[0])}" if volts else "open collector"
            yield "2", _named(ends[0]), _named(ends[1]), level, f"{pins[given[0]].amps:g} A at most"


def _named(pins: list[str]) -> str:
    return ", ".join(pins)
