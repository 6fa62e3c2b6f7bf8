"""Which pins are one conductor, once a car is chosen: harness, boards and electrical.yml joined."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, pairwise, product
from pathlib import Path
from typing import Any

from circuit import components, devices, joined
from harness import DIAGRAMS, HERE, WiringError, load, read, wires

KINDS = ("ground", "battery", "source", "load", "output", "open", "input", "analog", "bus",
         "plain")
OHM = {"Ohm": 1.0, "kOhm": 1e3}
ALONE = (("second_ring",), ("capture",), ("lidar_feed",), ("receiver", "divider"))
"""Diagrams that go with any other; those of one entry are tried together."""
CUTOFFS = ("", "cutoff_mux", "cutoff_oe")
ROUTES = ("", "smallest", "pi5", "orin", "desk")
Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Pin:
    """What a pin gives and takes; the words are explained at the top of electrical.yml. V, A."""

    kind: str
    gives: Span = (0.0, 0.0)
    takes: Span = (0.0, 0.0)
    amps: float = 0.0
    drop: Span = (0.0, 0.0)
    fed: str = ""
    switch: str = ""
    through: bool = False
    clamp: bool = False
    cmos: bool = False
    pull: bool = False
    limited: bool = False


@dataclass(frozen=True, slots=True)
class Car:
    """One way to build: diagrams beside the minimal one, and a variant of electrical.yml."""

    options: tuple[str, ...] = ()
    variant: str = "as drawn"

    def __str__(self) -> str:
        """As a fault names it."""
        extra = "" if self.variant == "as drawn" else f", {self.variant}"
        return " + ".join(("minimal", *self.options)) + extra


@dataclass(frozen=True, slots=True)
class Circuit:
    """The nets of one car.

    net: pin -> name of its net; on: net -> its pins; split: as ``net``, each fuse out.
    resistors: (net, net, Ohm). kinds: kind -> (pin, facts, net) of what is connected.
    earth: device -> nets of its grounds. wires: (pin, pin, id of the cable); carries: id -> A.
    fuses: (its two pins, A).
    """

    net: dict[str, str]
    on: dict[str, list[str]]
    split: dict[str, str]
    resistors: list[tuple[str, str, float]]
    pins: dict[str, Pin]
    kinds: dict[str, list[tuple[str, Pin, str]]]
    earth: dict[str, set[str]]
    wires: list[tuple[str, str, str]]
    carries: dict[str, float]
    fuses: list[tuple[tuple[str, ...], float]]
    board: dict[str, str]

    def of(self, *kinds: str) -> list[tuple[str, Pin, str]]:
        """Pin, facts and net of every connected pin of these kinds."""
        return [x for kind in kinds for x in self.kinds.get(kind, ())]

    def ground(self, pin: str) -> set[str]:
        """Ground nets of the device that carries a pin."""
        plug = device(pin)
        return self.earth.get(self.board.get(plug, plug), set())


class Harness:
    """The sources of a folder, read once: diagrams, boards, facts. Raises WiringError."""

    def __init__(self, folder: Path = HERE) -> None:
        self.facts = read(folder / "electrical.yml")
        self.pins = {name: pin_of(name, entry) for name, entry in self.facts["pins"].items()}
        diagrams = {name: load(name, folder) for name in DIAGRAMS}
        self.meta = {name: data["metadata"] for name, data in diagrams.items()}
        on_board = [(d, c) for d in devices(folder) for c in components(d, folder)]
        series = {f"{d} {c.ends[1]}" for d, c in on_board if c.ends[0] == f"lead {c.ends[1]}"}
        self.lines = {name: [(w.cable, (node(*w.start, series), node(*w.end, series),
                                        data["cables"][w.cable]["pn"]))
                             for w in wires(name, folder)] for name, data in diagrams.items()}
        """Diagram -> cable, (pin, pin, what the cable is) of each wire."""
        self.groups: list[list[str]] = [group for entry in self.facts["boards"].values()
                                        for group in entry["joined"]]
        self.groups += [[f"{d} {x}" for x in (a, *others)] for d in devices(folder)
                        for a, others in joined(d, folder).items()]
        values = [(f"{d} a", f"{d} b", value) for d, value in self.facts["resistors"].items()]
        values += [tuple(x) for x in self.facts["inside"]]
        values += [(f"{d} {c.ends[0]}", f"{d} {c.ends[1]}", c.value) for d, c in on_board]
        self.resistors = [(a, b, ohm) for a, b, value in values
                          if (ohm := ohms(value)) is not None]
        self.board = {p: b for b, entry in self.facts["boards"].items() for p in entry["plugs"]}

    def cars(self) -> Iterator[Car]:
        """Every car that can be built from the diagrams, one after the other."""
        for *some, cutoff, route in product(*[((), names) for names in ALONE], CUTOFFS, ROUTES):
            chosen = tuple(word for word in (*chain(*some), cutoff, route) if word)
            if not any(other in chosen for word in chosen
                       for other in self.meta[word].get("excludes", ())):
                for variant in self.facts["variants"]:
                    yield Car(chosen, variant)

    def circuit(self, car: Car, without: str = "") -> Circuit:
        """The nets of one car; ``without``: a cable that is pulled. Raises WiringError."""
        variant = [self.facts["variants"][car.variant]]
        variant += [x for k, x in variant[0].items() if k in {f"with {o}" for o in car.options}]
        lines = list(self._lines(car, variant, without))
        used = {device(end) for line in lines for end in line[:2]}
        copper = [line[:2] for line in lines]
        for group in self.groups:
            here = [end for end in group if device(end) in used]
            copper += pairwise(here)
        fuses = [(tuple(f["between"]), f["amps"]) for name, f in self.facts["fuses"].items()
                 if name in used]
        net = union([*copper, *(ends for ends, _ in fuses)])
        resistors = [(net.setdefault(a, a), net.setdefault(b, b), ohm)
                     for a, b, ohm in self.resistors if device(a) in used]
        pins = self._pins(car, variant)
        for pin, said in pins.items():  # an input to which nothing leads is there all the same
            if said.cmos and device(pin) in used:
                net.setdefault(pin, pin)
        on: dict[str, list[str]] = {}
        kinds: dict[str, list[tuple[str, Pin, str]]] = {}
        earth: dict[str, set[str]] = {}
        for pin, name in net.items():
            on.setdefault(name, []).append(pin)
            if (pin_facts := pins.get(pin)) is not None:
                kinds.setdefault(pin_facts.kind, []).append((pin, pin_facts, name))
                if pin_facts.kind == "ground":
                    plug = device(pin)
                    earth.setdefault(self.board.get(plug, plug), set()).add(name)
        return Circuit(net, on, union(copper), resistors, pins, kinds, earth, lines,
                       self.facts["conductors"], fuses, self.board)

    def _lines(self, car: Car, variant: list[dict[str, Any]],
               without: str) -> Iterator[tuple[str, str, str]]:
        """Both ends of every conductor of a car and what it is."""
        names = ("minimal", *car.options)
        gone = {c for n in names for c in self.meta[n].get("replaces", ())} | {without}
        cut = {frozenset(pair) for entry in variant for pair in entry.get("cut", ())}
        for name in names:
            for cable, line in self.lines[name]:
                if cable not in gone and frozenset(line[:2]) not in cut:
                    yield line
        for entry in variant:
            yield from entry.get("wires", ())

    def _pins(self, car: Car, variant: list[dict[str, Any]]) -> dict[str, Pin]:
        """The facts of this car: those of each pin, what its diagrams and its variant change."""
        changes = [self.facts["computers"].get(option, {}) for option in car.options]
        changes += [entry.get("change", {}) for entry in variant]
        return self.pins | {n: pin_of(n, x) for change in changes for n, x in change.items()}


def pin_of(name: str, entry: dict[str, Any]) -> Pin:
    """One line of electrical.yml. Raises WiringError."""
    cells = {k: tuple(map(float, v)) if k in ("gives", "takes") else v for k, v in entry.items()}
    try:
        pin = Pin(**cells)
    except TypeError as error:
        raise WiringError(f"electrical.yml, {name}: {error}") from None
    wrong = [s for s in (pin.gives, pin.takes) if len(s) != 2 or s[0] > s[1]]
    if pin.kind not in KINDS or wrong:
        raise WiringError(f"electrical.yml, {name}: kind {pin.kind!r}, {wrong}; expected one of "
                          f"{', '.join(KINDS)} and [least, most]")
    return pin


def ohms(value: str) -> float | None:
    """Of "10 kOhm"; None for what is no resistor."""
    number, unit = value.split()
    return float(number) * OHM[unit] if unit in OHM else None


def node(plug: str, label: str, series: set[str]) -> str:
    """The name of a pin here; of a wire with a resistor in it "MUX lead 1", its far end."""
    pin = re.sub(r" (\(.*\)|by \d+k)$", "", label)
    return f"{plug} lead {pin}" if f"{plug} {pin}" in series else f"{plug} {pin}"


def device(pin: str) -> str:
    """The plug or chip that carries a pin."""
    return pin.partition(" ")[0]


def union(pairs: Iterable[tuple[str, ...]]) -> dict[str, str]:
    """Pin -> one pin that stands for all it is joined to."""
    parent: dict[str, str] = {}

    def top(x: str) -> str:
        parent.setdefault(x, x)
        while parent[x] != x:
            parent[x] = parent[parent[x]]
            x = parent[x]
        return x

    for a, b in pairs:
        parent[top(a)] = top(b)
    return {x: top(x) for x in parent}
