"""Hardware between PCA9685 and ESC: none, a MOSFET on /OE, or a multiplexer.

The Nano's pins drive it, each low, high or released (None).

    /OE   D6 high -> MOSFET on -> /OE low -> outputs on
    mux   D5 high -> ESC gets channel 1, else the Nano's own pulse on D9;
          its second section does the same to channel 15 on the way to D8

Wirings that are wrong on purpose (``FLAWED``) are the negative controls: where
an input floats or is undefined, they show what is worst.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from dart_hal.core.errors import UsageError
from dart_lab.sim.levels import LOGIC_V, divided, level
from dart_lab.sim.pca9685 import Pca9685
from dart_lab.sim.pwm_output import Pulse

CUTOFFS = {"none": 0, "oe": 1, "mux": 2}
"""Values of the Nano's parameter safety_out."""

INPUT_FILTER = 5e-6
"""s; a gap or a stub shorter than this does not pass the low-pass at an ESC's input (4.7 k and
1 nF, assumed: no source for DART's ESC). A gap of the 3.3 us between the Nano's own pulse and
its select joins two pulses to one, the worse reading of the two."""

PinEdges = Iterable[tuple[float, str, Any]]


class Wiring(Protocol):
    """What lies between the board and the ESC; ``live``: wants every tick.

    ``captured``: the spare channel reaches D8 as things stand.
    """

    live: bool

    @property
    def captured(self) -> bool: ...

    def pins(self, edges: PinEdges) -> None:
        """Edges (t, pin, level) of the Nano's outputs since the last call."""

    def power(self, on: bool, t: float) -> None:
        """The Nano's USB cable, with supply and ground, goes in or out."""

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        """Pulses at the ESC that ended since the last call; board is advanced to now."""


class Direct:
    """The ESC's lead is plugged into the board."""

    live = False

    def __init__(self, pca: Pca9685) -> None:
        self._output = pca.output

    @property
    def captured(self) -> bool:
        return True

    def pins(self, edges: PinEdges) -> None:
        """The Nano has no say."""

    def power(self, on: bool, t: float) -> None:
        """It does not matter: see ``pins``."""

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        return self._output.take(channel)


@dataclass(frozen=True, slots=True)
class Gate:
    """/OE: pull-up of the cut-off and pull-down of the board [ohm], None = the board has none."""

    pull_up: float = 1e3
    board_pull_down: float | None = 10e3


class OutputEnable(Direct):
    """/OE is pulled high and only a living Nano pulls it low.

    The gate has 10 k to ground: a released D6 leaves the MOSFET off. Many boards pull
    /OE low themselves; where the two pulls meet between the levels, the outputs stay on.
    """

    live = True

    def __init__(self, pca: Pca9685, parts: Gate | None = None) -> None:
        super().__init__(pca)
        self._pca = pca
        parts = parts or Gate()
        self._disables = level(divided(LOGIC_V, parts.pull_up, parts.board_pull_down)) is True
        pca.set_oe(self._disables, 0.0)

    @property
    def captured(self) -> bool:
        return not self._output.disabled

    def pins(self, edges: PinEdges) -> None:
        for t, pin, on in edges:
            if pin == "D6":
                self._pca.set_oe(self._disables and not on, t)


@dataclass(frozen=True, slots=True)
class Select:
    """What the multiplexer has at its input from D9: a pull-down, a ground wire to the Nano."""

    pull_down: bool = True
    ground: bool = True


class EscInput:
    """Levels at an ESC's input to pulses, behind its low-pass."""

    def __init__(self) -> None:
        self._rise: float | None = None
        self._fall: float | None = None
        self._done: list[Pulse] = []

    def put(self, t: float, high: bool) -> None:
        """The level changes at t, or does not."""
        if high and self._fall is not None and t - self._fall < INPUT_FILTER:
            self._fall = None                    # the gap was too short: one pulse
        elif high and (self._rise is None or self._fall is not None):
            self._end()
            self._rise = t
        elif not high and self._rise is not None and self._fall is None:
            self._fall = t

    def take(self, now: float) -> list[Pulse]:
        """Pulses that are over for certain."""
        if self._fall is not None and now - self._fall >= INPUT_FILTER:
            self._end()
        done, self._done = self._done, []
        return done

    def _end(self) -> None:
        if self._rise is not None and self._fall is not None \
                and self._fall - self._rise >= INPUT_FILTER:
            self._done.append((self._rise, self._fall))
        self._rise = self._fall = None


class Multiplexer(Direct):
    """Two pulse sources and one lead; a switch inside a pulse cuts or joins it.

    Select has 10 k to ground in every variant. The chip takes 0.04 us to switch:
    nothing beside the ESC's own filter.
    """

    live = True

    def __init__(self, pca: Pca9685, parts: Select | None = None) -> None:
        super().__init__(pca)
        self._parts = parts or Select()
        self._edges: list[tuple[float, int, str, bool | None]] = []
        self._levels: dict[str, bool | None] = {
            "D5": None, "D9": None, "pca": False, "power": True}
        self._told: float | None = None
        self._input = EscInput()
        self._order = 0

    def pins(self, edges: PinEdges) -> None:
        for t, pin, on in edges:
            if pin in ("D5", "D9"):
                self._note(t, pin, None if on is None else bool(on))

    def power(self, on: bool, t: float) -> None:
        self._note(t, "power", on)

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        for rise, fall in self._output.take(channel):
            self._board_rise(rise)
            self._note(fall, "pca", False)
        under_way = self._output.high_since(channel)
        if under_way is not None:
            self._board_rise(under_way)
        for t, _, what, on in sorted(self._edges, key=lambda edge: edge[:2]):
            self._levels[what] = on
            self._input.put(t, self._passed())
        self._edges.clear()
        return self._input.take(now)

    def _passed(self) -> bool:
        """1Y: the level on the ESC's lead."""
        levels = self._levels
        if levels["D5"]:
            return bool(levels["pca"])
        if levels["D9"] is not None:
            return levels["D9"]
        grounded = self._parts.ground and not levels["power"]  # by the dead Nano's clamps
        floats = not (self._parts.pull_down or grounded)
        return floats and bool(levels["pca"])    # the live wire beside it couples over

    def _board_rise(self, t: float) -> None:
        if t != self._told:
            self._told = t
            self._note(t, "pca", True)

    def _note(self, t: float, what: str, on: bool | None) -> None:
        self._order += 1
        self._edges.append((t, self._order, what, on))


FLAWED: dict[str, Gate | Select] = {
    "oe-weak": Gate(pull_up=10e3),
    "mux-floating": Select(pull_down=False, ground=False),
    "mux-grounded": Select(pull_down=False),
    "mux-no-ground": Select(ground=False),
}
"""A 10 k pull-up against the board's 10 k; no pull-down at the input from D9, without and with
a ground wire of its own; the pull-down alone, which is enough for the ESC."""


def make_wiring(name: str, pca: Pca9685) -> Wiring:
    """The cut-off of that name, also one of `FLAWED`. Raises UsageError."""
    parts = FLAWED.get(name)
    if name == "oe" or isinstance(parts, Gate):
        return OutputEnable(pca, parts if isinstance(parts, Gate) else None)
    if name == "mux" or isinstance(parts, Select):
        return Multiplexer(pca, parts if isinstance(parts, Select) else None)
    if name != "none":
        raise UsageError(f"no cut-off {name!r}", expected=", ".join(CUTOFFS))
    return Direct(pca)
