"""Hardware cut-off between PCA9685 and ESC: none, a MOSFET on /OE, or a multiplexer.

The Nano's pins control it; each is low, high or released (None).

    /OE   D6 high -> MOSFET on -> /OE low -> outputs on
    mux   D5 high -> ESC gets channel 1, else the Nano's own pulse on D9;
          its second section does the same for channel 15 to D8

Wirings with a fault (``FLAWED_WIRINGS``) are negative controls: where an input floats or is
undefined, the worst case is simulated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

from dart_hal.core.errors import UsageError
from dart_lab.sim.levels import LOGIC_V, divider_voltage, logic_level
from dart_lab.sim.pca9685 import Pca9685Model
from dart_lab.sim.pwm_output import Pulse

# Values of the Nano's parameter safety_out.
CUTOFFS = {"none": 0, "oe": 1, "mux": 2}

# Shortest gap or pulse that passes the low-pass at an ESC's input [s]: 4.7 k and 1 nF, assumed,
# since there is no source for DART's ESC. The gap of 3.3 us between the Nano's own pulse and its
# select is shorter, so it joins two pulses, which is the worse case.
INPUT_FILTER = 5e-6

PinEdges = Iterable[tuple[float, str, Any]]


class Wiring(Protocol):
    """Circuit between the board and the ESC; ``needs_ticks``: it is called at every tick.

    ``capture_gate``: pin of the Nano that lets the spare channel to D8 while it is high; "": none.
    """

    needs_ticks: bool
    capture_gate: str

    def apply_pin_edges(self, edges: PinEdges) -> None:
        """Take over edges (t, pin, level) of the Nano's outputs since the last call."""

    def set_power(self, on: bool, t: float) -> None:
        """Connect or disconnect the Nano's USB cable, with its supply and its ground."""

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        """Return pulses at the ESC that ended since the last call; the board is at ``now``."""


class Direct:
    """No cut-off: the ESC is connected to the board."""

    needs_ticks = False
    capture_gate = ""

    def __init__(self, pca: Pca9685Model) -> None:
        self._output = pca.output

    def apply_pin_edges(self, edges: PinEdges) -> None:
        """Do nothing: the Nano has no influence on the ESC."""

    def set_power(self, on: bool, t: float) -> None:
        """Do nothing: the Nano has no influence on the ESC."""

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        return self._output.take(channel)


@dataclass(frozen=True, slots=True)
class OutputEnableParts:
    """Pull-up of the cut-off and pull-down of the board at /OE [ohm], None = no pull-down."""

    pull_up: float = 1e3
    board_pull_down: float | None = 10e3


class OutputEnable(Direct):
    """A pull-up keeps /OE high, which disables the outputs; only a running Nano pulls it low.

    The gate of the MOSFET has 10 k to ground, so it is off when D6 is released. Many boards have a
    pull-down at /OE. If the voltage divider ends between the logic levels, the outputs stay on.
    """

    needs_ticks = True

    def __init__(self, pca: Pca9685Model, parts: OutputEnableParts | None = None) -> None:
        super().__init__(pca)
        self._pca = pca
        parts = parts or OutputEnableParts()
        released = divider_voltage(LOGIC_V, parts.pull_up, parts.board_pull_down)
        self._disables = logic_level(released) is True
        self.capture_gate = "D6" if self._disables else ""
        pca.set_oe(self._disables, 0.0)

    def apply_pin_edges(self, edges: PinEdges) -> None:
        for t, pin, on in edges:
            if pin == "D6":
                self._pca.set_oe(self._disables and not on, t)


@dataclass(frozen=True, slots=True)
class MultiplexerParts:
    """Parts at the multiplexer's input from D9: a pull-down, a ground wire to the Nano."""

    pull_down: bool = True
    ground: bool = True


class EscInput:
    """Pulses that an ESC sees behind its low-pass, from the levels at its input."""

    def __init__(self) -> None:
        self._rise: float | None = None
        self._fall: float | None = None
        self._done: list[Pulse] = []

    def set_level(self, t: float, high: bool) -> None:
        """Set the level from t [s] on."""
        if high and self._fall is not None and t - self._fall < INPUT_FILTER:
            # The gap is too short for the filter: it joins two pulses.
            self._fall = None
        elif high and (self._rise is None or self._fall is not None):
            self._finish_pulse()
            self._rise = t
        elif not high and self._rise is not None and self._fall is None:
            self._fall = t

    def take(self, now: float) -> list[Pulse]:
        """Return the pulses that have ended and that no short gap can prolong."""
        if self._fall is not None and now - self._fall >= INPUT_FILTER:
            self._finish_pulse()
        done = self._done
        self._done = []
        return done

    def _finish_pulse(self) -> None:
        if self._rise is not None and self._fall is not None \
                and self._fall - self._rise >= INPUT_FILTER:
            self._done.append((self._rise, self._fall))
        self._rise = self._fall = None


class Multiplexer(Direct):
    """A switch between two pulse sources; switching inside a pulse cuts or joins pulses.

    The select input has 10 k to ground in every variant. The chip switches in 0.04 us, which is
    negligible compared with the ESC's filter.
    """

    needs_ticks = True
    capture_gate = "D5"

    def __init__(self, pca: Pca9685Model, parts: MultiplexerParts | None = None) -> None:
        super().__init__(pca)
        self._parts = parts or MultiplexerParts()
        self._edges: list[tuple[float, int, str, bool | None]] = []
        self._levels: dict[str, bool | None] = {
            "D5": None, "D9": None, "pca": False, "power": True}
        self._last_board_rise: float | None = None
        self._input = EscInput()
        self._order = 0

    def apply_pin_edges(self, edges: PinEdges) -> None:
        for t, pin, on in edges:
            if pin in ("D5", "D9"):
                self._queue_edge(t, pin, None if on is None else bool(on))

    def set_power(self, on: bool, t: float) -> None:
        self._queue_edge(t, "power", on)

    def esc_pulses(self, channel: int, now: float) -> list[Pulse]:
        for rise, fall in self._output.take(channel):
            self._board_rise(rise)
            self._queue_edge(fall, "pca", False)
        rise_now = self._output.high_since(channel)
        if rise_now is not None:
            self._board_rise(rise_now)
        # Edges of all inputs in the order of their times, those of one time as they came.
        for t, _, what, on in sorted(self._edges, key=lambda edge: edge[:2]):
            self._levels[what] = on
            self._input.set_level(t, self._output_level())
        self._edges.clear()
        return self._input.take(now)

    def _output_level(self) -> bool:
        """Return the level of output 1Y, at the ESC."""
        levels = self._levels
        if levels["D5"]:
            return bool(levels["pca"])
        if levels["D9"] is not None:
            return levels["D9"]
        # D9 is released: a Nano without supply pulls it down by its clamp diodes and the ground
        # wire, else it floats without a pull-down. A floating input follows the neighbouring wire.
        grounded = self._parts.ground and not levels["power"]
        floats = not (self._parts.pull_down or grounded)
        return floats and bool(levels["pca"])

    def _board_rise(self, t: float) -> None:
        if t != self._last_board_rise:
            self._last_board_rise = t
            self._queue_edge(t, "pca", True)

    def _queue_edge(self, t: float, what: str, on: bool | None) -> None:
        self._order += 1
        self._edges.append((t, self._order, what, on))


# oe-weak: a 10 k pull-up against the board's 10 k. mux-floating, mux-grounded: no pull-down at the
# input from D9, without and with a ground wire. mux-no-ground: the pull-down alone, which is enough
# for the ESC.
FLAWED_WIRINGS: dict[str, OutputEnableParts | MultiplexerParts] = {
    "oe-weak": OutputEnableParts(pull_up=10e3),
    "mux-floating": MultiplexerParts(pull_down=False, ground=False),
    "mux-grounded": MultiplexerParts(pull_down=False),
    "mux-no-ground": MultiplexerParts(ground=False),
}


def make_wiring(name: str, pca: Pca9685Model) -> Wiring:
    """Return the cut-off of that name, or one of `FLAWED_WIRINGS`. Raises UsageError."""
    parts = FLAWED_WIRINGS.get(name)
    if name == "oe" or isinstance(parts, OutputEnableParts):
        return OutputEnable(pca, parts if isinstance(parts, OutputEnableParts) else None)
    if name == "mux" or isinstance(parts, MultiplexerParts):
        return Multiplexer(pca, parts if isinstance(parts, MultiplexerParts) else None)
    if name != "none":
        raise UsageError(f"no cut-off {name!r}", expected=", ".join(CUTOFFS))
    return Direct(pca)
