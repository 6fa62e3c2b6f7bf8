"""The harness as data: parts.yml and one file per diagram, merged and read as single wires."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

HERE = Path(__file__).resolve().parent
DIAGRAMS = ("minimal", "second_ring", "capture", "cutoff_mux", "cutoff_oe", "lidar_feed",
            "receiver", "divider", "smallest", "pi5", "orin", "desk")
WORDS = {"BK": "black", "BN": "brown", "BU": "blue", "GN": "green", "OG": "orange", "RD": "red",
         "VT": "violet", "WH": "white", "YE": "yellow", "": "as it comes"}

Row = tuple[str, str, str, str]
"""One drawn wire: pin, pin, colour, its word."""
Chain = tuple[str, str, str, list[Row]]
"""Device, cable, device, wires."""

PLUGGED = "plugs at both ends"
"""Note of a ready-made cable."""


class WiringError(ValueError):
    """A diagram that cannot be read: which one, what was found, what exists."""


@dataclass(frozen=True, slots=True)
class Wire:
    """One conductor, from pin to pin; pins by their label, else by their number."""

    cable: str
    colour: str
    start: tuple[str, str]
    end: tuple[str, str]

    def pin_at(self, device: str) -> str | None:
        """Its pin on ``device``, if it ends there."""
        return next((p for d, p in (self.start, self.end) if d == device), None)


def read(path: Path) -> dict[str, Any]:
    """A YAML file. What it holds is shared by all who read the same text: change nothing in it."""
    return _parsed(path.read_text(encoding="utf-8"))


@lru_cache(maxsize=64)
def _parsed(text: str) -> dict[str, Any]:
    """Through libyaml where there is one: ten times as fast."""
    data: dict[str, Any] = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return data


def parts(folder: Path = HERE) -> dict[str, Any]:
    """parts.yml as it stands."""
    return read(folder / "parts.yml")


def load(name: str, folder: Path = HERE) -> dict[str, Any]:
    """One diagram with the connectors that it uses: what is drawn. Raises WiringError."""
    known = parts(folder)["connectors"]
    data = dict(read(folder / f"{name}.yml"))
    used = [next(iter(link)) for chain in data["connections"] for link in chain]
    for word in used:
        if word not in known and word not in data["cables"]:
            raise WiringError(f"{name}.yml connects {word!r}, which is neither a cable of that "
                              f"file nor one of {', '.join(known)}")
    own = data["metadata"].get("here", {})  # what a part is in this diagram alone
    data["connectors"] = {n: known[n] | own.get(n, {}) for n in known if n in used}
    return data


def wires(name: str, folder: Path = HERE) -> list[Wire]:
    """Every conductor of a diagram. Raises WiringError."""
    data = load(name, folder)
    return [wire for link in data["connections"] for wire in _between(data, link, name)]


def _between(data: dict[str, Any], connection: list[dict[str, Any]], name: str) -> list[Wire]:
    """The wires of one cable, pin by pin."""
    (a, pins_a), (w, numbers), (b, pins_b) = (next(iter(x.items())) for x in connection)
    lists = [_spread(x) for x in (pins_a, numbers, pins_b)]
    if len({len(x) for x in lists}) != 1:
        raise WiringError(f"{name}.yml, {w}: {[len(x) for x in lists]} pins and wires, "
                          "expected as many on each side")
    colours = data["cables"][w].get("colors", [])
    return [Wire(w, colours[int(n) - 1] if colours else "",
                 (a, _label(data, a, p, name)), (b, _label(data, b, q, name)))
            for p, n, q in zip(*lists, strict=True)]


def chains(name: str, folder: Path = HERE) -> list[Chain]:
    """The cables as they are drawn. Raises WiringError.

    A ready-made cable whose plugs leave no choice (USB) is drawn as one wire.
    """
    data = load(name, folder)
    found: list[Chain] = []
    for connection in data["connections"]:
        single = _between(data, connection, name)
        (a, _), (b, _), cable = single[0].start, single[0].end, single[0].cable
        rows = [(w.start[1], w.end[1], w.colour, WORDS[w.colour]) for w in single]
        if data["cables"][cable]["type"].startswith("USB"):
            rows = [("plug", "plug", "", "cable")]
        found.append((a, cable, b, rows))
    return found


def _spread(pins: list[Any]) -> list[str]:
    """["1-3"] -> 1, 2, 3: a range stands for its pins."""
    out: list[str] = []
    for pin in map(str, pins):
        low, dash, high = pin.partition("-")
        if dash and low.isdigit() and high.isdigit():
            out += map(str, range(int(low), int(high) + 1))
        else:
            out.append(pin)
    return out


def _label(data: dict[str, Any], device: str, pin: str, name: str) -> str:
    """A pin by its number, and its label where it has one: "4 (5V)"."""
    part = data["connectors"][device]
    labels = [str(x) for x in part.get("pinlabels", part.get("pins"))]
    numbers = [str(x) for x in part.get("pins", range(1, len(labels) + 1))]
    if pin not in numbers:
        raise WiringError(f"{name}.yml: {device} has no pin {pin!r}; it has {', '.join(numbers)}")
    label = labels[numbers.index(pin)]
    return pin if label == pin else f"{pin} ({label})"


def table(name: str, folder: Path = HERE) -> str:
    """The wires as a Markdown table, in the order in which they are plugged.

    A cable with plugs at both ends is one row; a device is named where its wires begin.
    """
    data, known = load(name, folder), parts(folder)["connectors"]
    lines = ["| from | pin | to | pin | colour |", "|---|---|---|---|---|"]
    last = ("", "", "")
    for wire in wires(name, folder):
        (a, p), (b, q) = wire.start, wire.end
        cable, colour = data["cables"][wire.cable], WORDS[wire.colour]
        if cable.get("notes") == PLUGGED:
            p, q, colour = "plug", "plug", f"`{cable['pn']}`"
        again = (a, b, wire.cable) == last
        names = ("", "") if again else (_say(known, a), _say(known, b))
        if not again or cable.get("notes") != PLUGGED:
            lines.append(f"| {names[0]} | {p} | {names[1]} | {q} | {colour} |")
        last = (a, b, wire.cable)
    return "\n".join(lines)


def _say(known: dict[str, Any], name: str) -> str:
    """What a builder calls it; with the subtype where several share a type."""
    kind = known[name]["type"]
    alone = [part["type"] for part in known.values()].count(kind) == 1
    return str(kind if alone else f"{kind}: {known[name]['subtype']}")
