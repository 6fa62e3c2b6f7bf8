"""Which nets of a circuit are live with some supplies on, and what is drawn from them."""

from __future__ import annotations

from dataclasses import dataclass

from nets import Circuit, Pin, Span

EFFICIENCY = 0.85
"""Power out over power in of a regulator [assumed]."""


@dataclass(frozen=True, slots=True)
class State:
    """A circuit with some supplies on. ``live``: net -> V; ``roots``: net -> its regulators."""

    circuit: Circuit
    live: dict[str, Span]
    roots: dict[str, frozenset[str]]
    pulled: bool

    def powered(self, pin: Pin) -> bool:
        """Whether what feeds ``pin`` is there."""
        return not pin.fed or self.circuit.net.get(pin.fed) in self.live


def supplied(c: Circuit, on: frozenset[str], pulled: bool) -> State:
    """Which nets are live: from the batteries through regulators and switches."""
    live: dict[str, Span] = {}
    roots: dict[str, frozenset[str]] = {}
    sources = c.of("battery", "source")
    for _ in sources:
        before = len(live), sum(map(len, roots.values()))
        for name, pin, net in sources:
            feeding = c.net.get(pin.fed, pin.fed)
            if pin.switch not in on if pin.kind == "battery" else feeding not in live:
                continue
            gives = pin.gives
            if pin.through:
                gives = live[feeding][0] - pin.drop[1], live[feeding][1] - pin.drop[0]
            root = roots[feeding] if pin.through else frozenset({name})
            low, high = live.get(net, gives)
            live[net] = min(low, gives[0]), max(high, gives[1])
            roots[net] = roots.get(net, frozenset()) | root
        if before == (len(live), sum(map(len, roots.values()))):
            break
    return State(c, live, roots, pulled)


def drawn(s: State, net: str) -> float:
    """A that loads of a net draw, those behind regulators included."""
    total = 0.0
    for name in s.circuit.on[net]:
        pin = s.circuit.pins.get(name)
        if pin is not None and pin.kind == "load":
            total += pin.amps
    for name, pin, out in s.circuit.of("source"):
        if pin.fed and s.circuit.net.get(pin.fed) == net and out in s.live and out != net:
            up = 1.0 if pin.through else s.live[out][1] / (s.live[net][0] * EFFICIENCY)
            share = [n for n in s.circuit.on[out]
                     if (p := s.circuit.pins.get(n)) and p.kind == "source"]
            total += up * drawn(s, out) / len(share) if name in share else 0.0
    return total


def span(volts: Span) -> str:
    low, high = volts
    return f"{low:g} V" if low == high else f"{low:g} to {high:g} V"
