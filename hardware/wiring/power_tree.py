"""The power tree on one page: batteries, fuse, switches, regulators, loads, from electrical.yml."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drawing import MARGIN, WIDTH, Sheet
from electrical import states
from harness import HERE, parts
from nets import Car, Harness, Pin, device
from supply import State, drawn, span

SHOWN = Car(("second_ring", "cutoff_mux"))
"""The car of the picture: the paper's with what the guide recommends."""
INDENT, HIGH = 17, 33
PAINT = {"battery": "#f6d5d0", "source": "#dfe8f5", "load": "#eef3e4"}
"""Fill by kind of pin."""

EXPLAINED = (
    "Red: battery. Blue: what passes current on; \"2.5 of 4 A\" is what its loads draw at most and "
    "what it may give. Green: a load, the voltage that it takes and its current. Figures: data "
    "sheets, or assumed where electrical.yml says so. The motor draws more for moments. The Nano "
    "has no switch: it lives on its USB cable.")


@dataclass(frozen=True, slots=True)
class Box:
    """One line of the tree."""

    depth: int
    kind: str
    title: str
    figures: str


def everything_on(harness: Harness, car: Car) -> State:
    """The state with each supply on and the Nano's cable in."""
    *_, last = (state for _, state in states(car, harness) if not state.pulled)
    return last


def boxes(harness: Harness, car: Car, folder: Path = HERE) -> Iterator[Box]:
    """From each battery down, depth first. Raises WiringError."""
    state = everything_on(harness, car)
    known = parts(folder)["connectors"]

    def title(name: str) -> str:
        part, (_, _, pin) = known[device(name)], name.partition(" ")
        labels = part.get("pinlabels", ())
        numbers = [str(x) for x in part.get("pins", range(1, len(labels) + 1))]
        if labels and pin in numbers:
            pin = f"{labels[numbers.index(pin)]}, pin {pin}"
        what = str(part["type"]).removesuffix(", USB")
        return what if pin in ("+", "out +", "in +", "VCC", "VIN") else f"{what}: {pin}"

    def below(net: str, depth: int) -> Iterator[Box]:
        for name, pin, at in state.circuit.of("load"):
            if at == net:
                yield Box(depth, "load", title(name), f"{span(pin.takes)}; {pin.amps:g} A")
        for name, pin, out in state.circuit.of("source"):
            if out != net and state.circuit.net.get(pin.fed) == net:
                gives = state.live[out]
                yield Box(depth, "source", title(name), _gives(pin, gives, drawn(state, out)))
                yield from below(out, depth + 1)

    for name, pin, net in state.circuit.of("battery"):
        yield Box(0, "battery", title(name), _battery(state, name, pin, net))
        yield from below(net, 1)


def _gives(pin: Pin, gives: tuple[float, float], amps: float) -> str:
    kind = "passes on" if pin.through else "regulator,"
    return f"{kind} {span(gives)}; {amps:.3g} of {pin.amps:g} A"


def _battery(state: State, name: str, pin: Pin, net: str) -> str:
    fuse = next((f"fuse {amps:g} A" for ends, amps in state.circuit.fuses
                 if net in {state.circuit.net[e] for e in ends}), "protection in the board")
    return (f"{span(pin.gives)}; {drawn(state, net):.3g} of {pin.amps:g} A; {fuse}; "
            f"switch: {pin.switch}")


def drawing(folder: Path = HERE) -> str:
    """SVG of the tree."""
    harness, sheet = Harness(folder), Sheet()
    sheet.text(WIDTH / 2, 18, "Power tree, everything on", 13, "bold", "middle")
    sheet.y = 26
    above: list[float] = []
    for box in boxes(harness, SHOWN, folder):
        if not box.depth:
            sheet.y += 8
        x, y = MARGIN + INDENT * box.depth, sheet.y
        above[box.depth:] = [y + HIGH]
        if box.depth:
            left = x - INDENT + 7
            sheet.parts.append(f"<path d='M{left:g} {above[box.depth - 1]:g} V{y + HIGH / 2:g} "
                               f"H{x:g}' fill='none' stroke='#a33' stroke-width='1.6'/>")
        sheet.rect(x, y + 3, WIDTH - MARGIN - x, HIGH - 6, PAINT[box.kind])
        sheet.text(x + 6, y + 14.5, box.title, 10.5, "bold")
        sheet.text(x + 6, y + 26, box.figures, 9.5)
        sheet.y += HIGH
    sheet.y += 4
    sheet.paragraph(EXPLAINED)
    return sheet.svg("Power tree of the car")
