"""What is soldered beside the chip of a cut-off: components and bare wires, from parts.yml."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness import DIAGRAMS, HERE, WiringError, parts, wires


@dataclass(frozen=True, slots=True)
class Component:
    """``part``: its id in bom.csv. ``ends``: pins of the chip, or "lead N", the end of the wire
    that comes for pin N and reaches it through this component."""

    part: str
    value: str
    ends: tuple[str, str]


def devices(folder: Path = HERE) -> dict[str, dict[str, Any]]:
    """Name -> entry of parts.yml of what has such a board."""
    return {n: x for n, x in parts(folder)["connectors"].items() if "on_board" in x}


def components(device: str, folder: Path = HERE) -> list[Component]:
    """Every single one. Raises WiringError."""
    found = []
    for part, entry in devices(folder)[device]["on_board"].items():
        for pair in entry["between"]:
            if len(pair) != 2:
                raise WiringError(f"parts.yml, {device}, {part}: {pair} has {len(pair)} ends, "
                                  "expected two")
            found.append(Component(part, entry["value"], (str(pair[0]), str(pair[1]))))
    return found


def joined(device: str, folder: Path = HERE) -> dict[str, list[str]]:
    """Pin -> pins that a bare wire joins to it."""
    return {str(pin): [str(x) for x in others]
            for pin, others in devices(folder)[device].get("joined", {}).items()}


def names(device: str, folder: Path = HERE) -> dict[str, str]:
    """Pin -> its name on the chip; of a device without numbers nothing."""
    return {str(n): name for n, name in enumerate(devices(folder)[device].get("names", ()), 1)}


def goals(device: str, folder: Path = HERE) -> dict[str, list[str]]:
    """Pin -> all that hangs on it, in words: wires with what lies between, components, joints."""
    entry, series = devices(folder)[device], {}
    pins = list(names(device, folder)) or [p.split(" by")[0] for p in map(str, entry["pins"])]
    found: dict[str, list[str]] = {pin: [] for pin in pins}
    for c in components(device, folder):
        if c.ends[0].startswith("lead "):
            series[c.ends[1]] = c.value
    for there, other, pin in leads(device, folder):
        by = f" by {series[pin]}" if pin in series else ""
        found[pin].append(f"{there} {other}{by}")
    for c in components(device, folder):
        a, b = c.ends
        if a in found and b in found:
            found[a].append(f"{c.value} to {b}")
    for pin, others in joined(device, folder).items():
        for other in others:
            found.setdefault(other, []).append(f"bare wire to {pin}")
    return found


def leads(device: str, folder: Path) -> list[tuple[str, str, str]]:
    """(device, its pin, pin here) of every wire of the harness that ends on the board."""
    known, seen = parts(folder)["connectors"], []
    for diagram in DIAGRAMS:
        for wire in wires(diagram, folder):
            for (here, pin), (there, other) in ((wire.start, wire.end), (wire.end, wire.start)):
                if here == device:
                    name = known[there].get("short", known[there]["type"])
                    seen.append((name, other, re.sub(r"^(\S+) .*", r"\1", pin)))
    return seen


def said(device: str, folder: Path = HERE) -> list[str]:
    """One sentence for each kind of component and for the bare wire, as a drawing prints it."""
    kinds: dict[tuple[str, str], list[str]] = {}
    for c in components(device, folder):
        kinds.setdefault((c.value, c.part), []).append(" to ".join(c.ends))
    lines = [f"On its board {value} ({part}): {', '.join(ends)}."
             for (value, part), ends in kinds.items()]
    lines += [f"On its board a bare wire: {', '.join(others)} to {pin}."
              for pin, others in joined(device, folder).items()]
    return lines


def pin_table(device: str, folder: Path = HERE) -> str:
    """Every pin of the chip as a Markdown table, those that stay open included."""
    known = names(device, folder)
    lines = ["| pin | name | goes to |", "|---|---|---|"] if known else [
        "| pin | goes to |", "|---|---|"]
    for pin, ends in goals(device, folder).items():
        what = "; ".join(ends) or "nothing: an output that is not used"
        lines.append("| " + " | ".join(x for x in (pin, known.get(pin, ""), what) if x) + " |")
    return "\n".join(lines)


def part_table(device: str, folder: Path = HERE) -> str:
    """Every component and bare wire of the board, and what an ohmmeter reads from end to end
    while nothing is plugged and the chip is out."""
    known = names(device, folder)
    full = {p: f"{p} ({n})" for p, n in known.items()}
    full |= {f"lead {pin}": f"wire of {there} {other}"
             for there, other, pin in leads(device, folder)}
    lines = ["| part | from | to | meter reads |", "|---|---|---|---|"]
    for c in components(device, folder):
        a, b = (full.get(x, x) for x in c.ends)
        reads = c.value if "Ohm" in c.value else "no contact, after a moment"
        lines.append(f"| `{c.part}` | {a} | {b} | {reads} |")
    for pin, others in joined(device, folder).items():
        each = "each of " if len(others) > 1 else ""
        lines.append(f"| bare wire | {each}{', '.join(full.get(x, x) for x in others)} "
                     f"| {full.get(pin, pin)} | 0, beeps |")
    return "\n".join(lines)
