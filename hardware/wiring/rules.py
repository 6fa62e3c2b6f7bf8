"""The rules of the electrical check: each looks at one state of the supplies.

A rule yields (where, found, expected) of what it does not accept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from nets import Pin, device
from supply import State, drawn, span

WEAK = 100e3
"""Ohm: a higher resistance does not hold a CMOS input beside a wire that picks up noise."""
LOW = 0.8
"""V: most that an HCT input and a 2N7002 take for a low [data sheets]."""
DIODE = 0.7
"""V across a clamp [data sheets]."""
MAX_SOURCE = 10e3
"""Ohm: of a higher source an ATmega328P converts too little [data sheet]."""
ABOVE = 0.5
"""V above its supply at which the clamp of an input begins to conduct [data sheets]."""

Found = Iterator[tuple[str, str, str]]
Rule = Callable[[State], Found]


def unknown(s: State) -> Found:
    """A pin without facts is no pin that can be judged."""
    for name, net in s.circuit.net.items():
        if name not in s.circuit.pins and " lead " not in name and not device(
                name).startswith("R_"):
            yield name, "no line in electrical.yml", f"one; it is joined to {net}"


def short(s: State) -> Found:
    """Ground and a supply on one net."""
    for name, _, net in s.circuit.of("ground"):
        if net in s.live:
            yield (f"{name} and {', '.join(sorted(s.roots[net]))}",
                   f"a ground at {span(s.live[net])}", "ground and supply apart")


def sources(s: State) -> Found:
    """Two regulators on one net: the stronger one feeds the other backwards."""
    for roots in set(s.roots.values()):
        if len(roots) > 1:
            yield (" and ".join(sorted(roots)), f"{len(roots)} regulators feed one net",
                   "one; take a wire out")


def voltage(s: State) -> Found:
    """A load at a supply that it does not take."""
    for name, pin, net in s.circuit.of("load"):
        if net in s.live:
            low, high = s.live[net]
            if low < pin.takes[0] or high > pin.takes[1]:
                yield (f"{name} at {', '.join(sorted(s.roots[net]))}", span(s.live[net]),
                       span(pin.takes))


def current(s: State) -> Found:
    """A regulator, a pin or a battery that gives more than it may."""
    for name, pin, net in s.circuit.of("source", "battery"):
        passes_on = pin.through and any(s.circuit.net[r] == net for r in s.roots.get(net, ()))
        if net in s.live and not passes_on:
            amps = drawn(s, net)
            if amps > pin.amps + 1e-9:
                yield name, f"{amps:.3g} A drawn", f"{pin.amps:g} A at most"


def wire(s: State) -> Found:
    """A conductor thinner than what its load draws."""
    carries = s.circuit.carries
    loads: dict[str, list[tuple[str, str, str]]] = {}
    for a, b, what in s.circuit.wires:
        for end in (a, b):
            loads.setdefault(end, []).append((a, b, what))
    for name, pin, net in s.circuit.of("load"):
        ends = [n for n in s.circuit.on[net] if s.circuit.board.get(device(n), n) ==
                s.circuit.board.get(device(name), name)]
        here = [line for n in ends for line in loads.get(n, ()) if n in line[:2]]
        for a, b, what in here:
            if pin.amps / len(here) > carries.get(what, 0.0):
                yield (f"{a} to {b} ({what})", f"{pin.amps / len(here):.3g} A",
                       f"{carries.get(what, 0.0):g} A at most")


def fuse(s: State) -> Found:
    """A battery whose current nothing ends; a fuse above what its wires carry."""
    c = s.circuit
    for name, battery, _ in c.of("battery"):
        for other, pin, _ in c.of("load", "source"):
            if c.split[other] == c.split[name] and not pin.limited and not battery.limited:
                yield f"{name} to {other}", "no fuse between", "a fuse, or a load with its own"
    for ends, amps in c.fuses:
        nets = {c.split[end] for end in ends if end in c.split}
        for a, b, what in c.wires:
            if nets & {c.split[a], c.split[b]} and c.carries.get(what, 0.0) < amps:
                yield (f"{a} to {b} ({what})", f"carries {c.carries.get(what, 0.0):g} A",
                       f"at least the {amps:g} A of its fuse")
        for name, pin, _ in c.of("load"):
            if c.split[name] in nets and pin.amps > amps:
                yield name, f"{pin.amps:g} A drawn", f"at most the {amps:g} A of its fuse"


def drivers(s: State) -> Found:
    """Two push-pull outputs on one net."""
    found: dict[str, list[str]] = {}
    for name, _, net in s.circuit.of("output"):
        found.setdefault(net, []).append(name)
    for names in found.values():
        if len(names) > 1:
            yield " and ".join(sorted(names)), "two outputs drive one net", "one"


def reached(s: State, start: str) -> Iterator[tuple[str, float, float]]:
    """Net, series Ohm and share of the voltage, from a driven net on through its resistors."""
    yield start, 0.0, 1.0
    for a, b, ohm in s.circuit.resistors:
        for near, far in ((a, b), (b, a)):
            if near != start or far in s.live:
                continue
            grounds = set().union(*s.circuit.earth.values())
            if far not in grounds:
                down = min((r for x, y, r in s.circuit.resistors
                            if far in (x, y) and ({x, y} - {far}) & grounds), default=1e12)
                yield far, ohm, down / (ohm + down)


def meetings(s: State) -> Iterator[tuple[str, Pin, str, Pin, float, float]]:
    """Each live output with each input that it reaches: names, facts, series Ohm, share."""
    for out, gives, net in s.circuit.of("output", "bus"):
        if not s.powered(gives) or not gives.gives[1]:
            continue
        for far, ohm, share in reached(s, net):
            for name in s.circuit.on.get(far, ()):
                takes = s.circuit.pins.get(name)
                if takes is not None and takes.kind in ("input", "bus") and name != out:
                    yield out, gives, name, takes, ohm, share


def level(s: State) -> Found:
    """A high that is too high, or none, for the input that it meets."""
    for out, gives, name, takes, _, share in meetings(s):
        if not s.powered(takes):
            continue
        low, high = (share * v for v in gives.gives)
        supply = s.live.get(s.circuit.net.get(takes.fed, ""), takes.takes)
        most = min(takes.takes[1], supply[1] + ABOVE) if takes.clamp else takes.takes[1]
        if high > most:
            yield f"{out} to {name}", f"a high of {high:.3g} V", f"at most {most:.3g} V"
        elif low < takes.takes[0] and not _better(s, name, takes):
            yield f"{out} to {name}", f"a high of {low:.3g} V", f"at least {takes.takes[0]:g} V"


def _better(s: State, name: str, takes: Pin) -> bool:
    """A bus is as high as its highest pull-up."""
    return any(p.kind == "bus" and s.powered(p) and p.gives[0] >= takes.takes[0]
               for n in s.circuit.on[s.circuit.net[name]] if (p := s.circuit.pins.get(n)))


def clamp(s: State) -> Found:
    """An output that feeds a chip without supply through its clamp diode."""
    for out, gives, name, takes, ohm, _ in meetings(s):
        grounded = s.circuit.ground(out) & s.circuit.ground(name)
        if s.powered(takes) or not takes.clamp or not grounded:
            continue
        limit = min(gives.amps, takes.amps)
        amps = (gives.gives[1] - DIODE) / ohm if ohm else float("inf")
        if amps > limit:
            yield (f"{out} to {name}, whose chip is off",
                   f"{1e3 * amps:.3g} mA" if ohm else "a current that nothing limits",
                   f"{1e3 * limit:g} mA at most; a resistor in series")


def floating(s: State) -> Found:
    """An input that no resistor holds once the wire from its driver is off."""
    fixed = dict.fromkeys(set().union(*s.circuit.earth.values()), 0.0)
    fixed |= {net: volts[0] for net, volts in s.live.items()}
    for name, pin, net in s.circuit.of("input"):
        if pin.pull or net in fixed or not s.powered(pin):
            continue
        held = [(fixed[far], ohm) for a, b, ohm in s.circuit.resistors
                for near, far in ((a, b), (b, a)) if near == net and far in fixed and ohm <= WEAK]
        if not held:
            yield name, "nothing holds it when its wire is off", "a resistor to ground or supply"
            continue
        volts = sum(v / r for v, r in held) / sum(1 / r for _, r in held)
        if LOW < volts < pin.takes[0]:
            yield name, f"{volts:.3g} V when its wire is off", f"below {LOW:g} or above " \
                  f"{pin.takes[0]:g} V"


def ends_of(s: State, net: str) -> Iterator[tuple[str, float]]:
    """Ground and live nets behind the resistors of a net, with their Ohm; itself, if live."""
    fixed = set().union(*s.circuit.earth.values()) | set(s.live)
    if net in fixed:
        yield net, 1e-3
    for a, b, ohm in s.circuit.resistors:
        for near, far in ((a, b), (b, a)):
            if near == net and far in fixed:
                yield far, ohm


def analog(s: State) -> Found:
    """An analog input above what it measures, or too far behind; its clamp without supply."""
    for name, pin, net in s.circuit.of("analog"):
        ends = [(s.live[far][1] if far in s.live else 0.0, ohm) for far, ohm in ends_of(s, net)]
        if not s.powered(pin):
            amps = sum(max(v - DIODE, 0.0) / ohm for v, ohm in ends)
            if amps > pin.amps:
                yield (f"{name}, whose chip is off", f"{1e3 * amps:.3g} mA",
                       f"{1e3 * pin.amps:g} mA at most")
            continue
        siemens = sum(1.0 / ohm for _, ohm in ends) or 1e-12
        source = 1.0 / siemens
        volts = sum(v / ohm for v, ohm in ends) / siemens
        most = min(pin.takes[1], s.live[s.circuit.net[pin.fed]][0])
        if volts > most:
            yield name, f"{volts:.3g} V", f"at most {most:g} V"
        if source > MAX_SOURCE:
            yield (f"{name}, source", f"{source / 1e3:.3g} kOhm",
                   f"at most {MAX_SOURCE / 1e3:g} kOhm")


def common_ground(s: State) -> Found:
    """A signal between devices that share no ground; a cut-off's own, with USB out as well."""
    for out, _, net in s.circuit.of("output", "open", "bus"):
        for far, _, _ in reached(s, net):
            for name in s.circuit.on.get(far, ()):
                takes = s.circuit.pins.get(name)
                if takes is None or takes.kind not in ("input", "bus") or name == out:
                    continue
                if s.pulled and not (takes.cmos or "MUX" in out):
                    continue
                if not s.circuit.ground(out) & s.circuit.ground(name):
                    yield (f"{out} to {name}", "no ground in common"
                           + (", Nano's USB cable out" if s.pulled else ""),
                           "a ground wire next to that of the signal")
    for name, _, net in () if s.pulled else s.circuit.of("analog"):
        for root in {r for far, _ in ends_of(s, net) for r in s.roots.get(far, ())}:
            if not s.circuit.ground(root) & s.circuit.ground(name):
                yield (f"{root} to {name}", "no ground in common",
                       "a ground wire next to that of the signal")


RULES: dict[str, Rule] = {
    "UNKNOWN_PIN": unknown, "SHORT": short, "TWO_REGULATORS": sources, "VOLTAGE": voltage,
    "CURRENT": current, "WIRE": wire, "NO_FUSE": fuse, "TWO_DRIVERS": drivers, "LEVEL": level,
    "CLAMP": clamp, "FLOATING": floating, "NO_GROUND": common_ground,
    "ANALOG": analog,
}
"""Name of a fault -> who finds it in one state of the supplies."""
