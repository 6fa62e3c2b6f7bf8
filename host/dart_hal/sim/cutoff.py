"""Hardware between PCA9685 and ESC: none, a MOSFET on /OE, or a multiplexer.

The Nano's pins drive it; a pin that is not driven is pulled low, and so is
one of a Nano without power.

    /OE   D6 high -> MOSFET on -> /OE low -> outputs on
    mux   D5 high -> ESC gets channel 1, else the Nano's own pulse on D9
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

from dart_hal.errors import UsageError
from dart_hal.sim.pca9685 import Pca9685
from dart_hal.sim.pwm_output import Pulse

CUTOFFS = {"none": 0, "oe": 1, "mux": 2}
"""Values of the Nano's parameter safety_out."""

PinEdges = Iterable[tuple[float, str, Any]]


class Wiring(Protocol):
    """What lies between the board and the ESC; ``live``: wants every tick."""

    live: bool

    def pins(self, edges: PinEdges) -> None:
        """Edges (t, pin, level) of the Nano's outputs since the last call."""

    def esc_pulses(self, channel: int) -> list[Pulse]:
        """Pulses at the ESC that ended since the last call; board is advanced."""


class Direct:
    """The ESC's lead is plugged into the board."""

    live = False

    def __init__(self, pca: Pca9685) -> None:
        self._output = pca.output

    def pins(self, edges: PinEdges) -> None:
        """The Nano has no say."""

    def esc_pulses(self, channel: int) -> list[Pulse]:
        return self._output.take(channel)


class OutputEnable(Direct):
    """/OE is pulled high and only a living Nano pulls it low."""

    live = True

    def __init__(self, pca: Pca9685) -> None:
        super().__init__(pca)
        self._pca = pca
        pca.set_oe(True, 0.0)

    def pins(self, edges: PinEdges) -> None:
        for t, pin, level in edges:
            if pin == "D6":
                self._pca.set_oe(not level, t)


class Multiplexer(Direct):
    """Two pulse sources and one lead; a switch inside a pulse cuts or joins it."""

    live = True

    def __init__(self, pca: Pca9685) -> None:
        super().__init__(pca)
        self._edges: list[tuple[float, int, str, bool]] = []
        self._levels = {"D5": False, "D9": False, "pca": False}
        self._told: float | None = None
        self._rise: float | None = None
        self._order = 0

    def pins(self, edges: PinEdges) -> None:
        for t, pin, level in edges:
            if pin in ("D5", "D9"):
                self._note(t, pin, bool(level))

    def esc_pulses(self, channel: int) -> list[Pulse]:
        for rise, fall in self._output.take(channel):
            self._board_rise(rise)
            self._note(fall, "pca", False)
        under_way = self._output.high_since(channel)
        if under_way is not None:
            self._board_rise(under_way)
        done = []
        for t, _, pin, level in sorted(self._edges):
            self._levels[pin] = level
            high = self._levels["pca"] if self._levels["D5"] else self._levels["D9"]
            if high and self._rise is None:
                self._rise = t
            elif not high and self._rise is not None:
                done.append((self._rise, t))
                self._rise = None
        self._edges.clear()
        return done

    def _board_rise(self, t: float) -> None:
        if t != self._told:
            self._told = t
            self._note(t, "pca", True)

    def _note(self, t: float, pin: str, level: bool) -> None:
        self._order += 1
        self._edges.append((t, self._order, pin, level))


def make_wiring(name: str, pca: Pca9685) -> Wiring:
    """The cut-off of that name. Raises UsageError."""
    kinds = {"none": Direct, "oe": OutputEnable, "mux": Multiplexer}
    if name not in kinds:
        raise UsageError(f"no cut-off {name!r}", expected=", ".join(kinds))
    return kinds[name](pca)
