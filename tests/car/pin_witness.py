"""Record every pulse of the ESC pin with the mode of the car at that time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

MODE_DELAY_S = 0.040
"""s that a pulse may end after the mode that allowed it."""
EXPIRY = 0.030 + 0.020
"""s: the frame step writes each 30 ms at least, and the PWM frame under way ends in 20 ms."""
CUT_WITHIN = 0.140
"""s from the last heartbeat to the ESC's neutral behind a cut-off."""
GAP = 0.025
"""s without a pulse: more than a PWM frame."""
LIVE_MODES = ("ARMED", "RAW")


@dataclass
class Witness:
    """``world`` of a simulated car; call ``record_mode`` at every State and after every call.

    ``muted``: times from which no heartbeat reached the Nano; ``resets`` of it
    and of the PCA9685.
    """

    world: object
    pulses: list[tuple[float, float, float]] = field(default_factory=list)
    modes: list[tuple[float, str]] = field(default_factory=list)
    commands: list[tuple[float, float]] = field(default_factory=list)
    muted: list[float] = field(default_factory=list)
    resets: list[float] = field(default_factory=list)
    _checked: int = 0

    def __post_init__(self) -> None:
        self.world.watchers.append(self._pulse)

    def _pulse(self, channel: int, pulse: tuple[float, float]) -> None:
        if channel == 1:
            rise, fall = pulse
            self.pulses.append((rise, fall, (fall - rise) * 1e6))

    def record_mode(self, t: float, mode: str) -> None:
        if not self.modes or self.modes[-1][1] != mode:
            self.modes.append((t, mode))

    def record_command(self, t: float, until: float) -> None:
        self.commands.append((t, until))

    def modes_in(self, start: float, end: float) -> set[str]:
        """Modes that held at some time from ``start`` to ``end``."""
        first = max(bisect_right(self.modes, (start, "~")) - 1, 0)
        return {mode for t, mode in self.modes[first:] if t <= end}

    def check(self, *, cutoff: str) -> None:
        """Every new pulse is neutral, or a live mode and a live command allow it.

        Without a ``cutoff`` FAULT may mean that the state of the pin is unknown.
        /OE acts in the middle of a pulse, and so does a chip that is
        reset: they may leave a stub, shorter than neutral, at that moment or
        before or behind the gap that they make. With the bus gone
        and the heartbeats too the Nano acts when it misses them.
        """
        allowed = (*LIVE_MODES, "FAULT") if cutoff == "none" else LIVE_MODES
        complete = [p for p in self.pulses[self._checked:] if p[1] < self.world.t - GAP]
        for k, (rise, fall, length) in enumerate(complete, self._checked):
            gap = cutoff != "none" and self._at_a_gap(k)
            cut = gap or any(abs(t - fall) < 1e-5 for t in self.resets)
            stub = length < NEUTRAL_US and cut
            if abs(length - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US or stub:
                continue
            allowed_modes = self.modes_in(fall - MODE_DELAY_S, fall)
            if allowed_modes == {"FAULT"} and any(t <= fall <= t + CUT_WITHIN for t in self.muted):
                continue
            assert allowed_modes & set(allowed), (
                f"{length:.0f} us at t = {rise:.4f} s while {allowed_modes}", self.modes[-6:])
            if "FAULT" not in allowed_modes:
                assert any(t <= fall and fall <= until + EXPIRY for t, until in
                           self.commands[-200:]), f"{length:.0f} us at {rise:.4f} s, no command"
        self._checked += len(complete)

    def _at_a_gap(self, k: int) -> bool:
        rise, fall, _ = self.pulses[k]
        before = self.pulses[k - 1][1] if k else -1.0
        after = self.pulses[k + 1][0] if k + 1 < len(self.pulses) else self.world.t
        return rise - before > GAP or after - fall > GAP


def no_pulse(bus) -> bool:
    """Whether neither servo nor ESC gets a pulse."""
    leds = bytearray(8)
    bus.writeto_then_readfrom(0x40, b"\x06", leds)
    return bool(leds[3] & 0x10 and leds[7] & 0x10)
