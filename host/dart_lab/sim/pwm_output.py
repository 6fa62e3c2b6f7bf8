"""Pulse trains of the PCA9685: counter, comparators, pin stage.

The output of a channel is a list of (rise, fall) times of its pin. Servo, ESC and all safety tests
use these times, never registers.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable

from dart_hal.core.errors import UsageError

Pulse = tuple[float, float]
OscillatorHz = float | Callable[[float], float]
Counts = tuple[tuple[int, int], ...]
NEVER = float("inf")


class PwmOutput:
    """Generator of pulses; each change acts at its own time.

    ``advance(t)`` computes all pins up to t. No pin changes before ``quiet_until``, so a caller may
    skip until then.
    """

    def __init__(self, oscillator: OscillatorHz, update: str = "next_frame") -> None:
        if update not in ("next_frame", "now"):
            raise UsageError(f"update {update!r}", expected="next_frame or now")
        self.quiet_until = 0.0
        self._oscillator = oscillator
        self._acts_at_once = update == "now"
        self._queue: list[tuple[float, int, Callable[[], None], bool]] = []
        self._order = 0
        self._t = 0.0
        self._running = self._blocked = self._oe = False
        self._prescale = 0x1E
        self._mode2 = 0x04
        self._frame = 0.0
        self._count = 0.0
        self._latched: list[Counts] = [()] * 16
        self._active: list[Counts] = [()] * 16
        self._level = [False] * 16
        self._rise: list[float | None] = [None] * 16
        self._done: list[list[Pulse]] = [[] for _ in range(16)]

    @property
    def period(self) -> float:
        """Return the length of the current PWM frame [s]."""
        return 4096 * self._count

    # -- changes, called through schedule() ------------------------------------

    def schedule(self, t: float, change: Callable[[], None], wakes: bool = False) -> None:
        """Let ``change`` act at time t, or at the time that has been computed if that is later.

        ``wakes``: a later ``sleep`` that acts before t cancels it.
        """
        self._order += 1
        t = max(t, self._t)
        insort(self._queue, (t, self._order, change, wakes))
        self.quiet_until = min(self.quiet_until, t)

    def sleep(self, t: float) -> None:
        """Stop the oscillator at t; a start that is pending then is cancelled."""
        self._queue = [e for e in self._queue if not (e[3] and e[0] > t)]
        self.schedule(t, self._stop)

    def start(self, blocked: bool = False) -> None:
        """Start the oscillator; with RESTART pending the channels stay low."""
        self._running = True
        self._blocked = blocked
        self._begin_frame(self._t)

    def resume(self) -> None:
        """Start the pulses with a new frame, after RESTART or an LED write that cancels it."""
        if self._blocked:
            self._blocked = False
            self._begin_frame(self._t)

    def _stop(self) -> None:
        """Stop the oscillator now, which ends a pulse."""
        self._running = False
        for channel in range(16):
            self._set_level(channel, False, self._t)

    def latch(self, leds: dict[int, Counts]) -> None:
        for channel, counts in leds.items():
            self._latched[channel] = counts
            if self._acts_at_once and self._running and not self._blocked:
                self._active[channel] = counts
                count = (self._t - self._frame) / self._count
                self._set_level(channel, any(a <= count < b for a, b in counts), self._t)

    def set_prescale(self, value: int) -> None:
        self._prescale = value

    def set_mode2(self, value: int) -> None:
        self._mode2 = value
        self._refresh_pins()

    def set_oe(self, disabled: bool) -> None:
        self._oe = disabled
        self._refresh_pins()

    # -- production ------------------------------------------------------

    def advance(self, t: float) -> None:
        """Compute the pins up to time t, with the changes that are due."""
        while self._queue and self._queue[0][0] <= t:
            due, _, change, _ = self._queue.pop(0)
            self._produce(due)
            change()
        self._produce(t)
        self.quiet_until = self._next_change()

    def take(self, channel: int) -> list[Pulse]:
        """Return the pulses of a channel that ended since the last call."""
        done = self._done[channel]
        if done:
            self._done[channel] = []
        return done

    def high_since(self, channel: int) -> float | None:
        """Return the rise of the present pulse [s], None = the pin is low."""
        return self._rise[channel]

    def upcoming(self, channel: int, until: float) -> list[tuple[float, bool]]:
        """Return the edges of a channel until a time, if no change comes and /OE is low."""
        if not self._running or self._blocked:
            return []
        edges = []
        frame = self._frame
        counts = self._active[channel]
        while counts and frame < until:
            for a, b in counts:
                edges += [(frame + a * self._count, True), (frame + b * self._count, False)]
            frame = frame + 4096 * self._count
            counts = self._latched[channel]
        return [(t, level) for t, level in edges if self._t < t <= until]

    def _produce(self, t: float) -> None:
        while self._running and not self._blocked:
            end = self._frame + 4096 * self._count
            upto = min(t, end)
            for channel, counts in enumerate(self._active):
                if counts:
                    self._produce_edges(channel, counts, upto)
            self._t = upto
            if t < end:
                return
            self._begin_frame(end)
        self._t = max(self._t, t)

    def _produce_edges(self, channel: int, counts: Counts, upto: float) -> None:
        frame = self._frame
        count = self._count
        now = self._t
        for a, b in counts:
            rise = frame + a * count
            fall = frame + b * count
            if fall > now and rise < upto and not self._level[channel]:
                self._set_level(channel, True, max(rise, now))
            if now < fall <= upto and b < 4096:
                self._set_level(channel, False, fall)

    def _begin_frame(self, t: float) -> None:
        osc = self._oscillator(t) if callable(self._oscillator) else self._oscillator
        self._frame = t
        self._count = (self._prescale + 1) / osc
        self._t = t
        self._active = list(self._latched)
        for channel, counts in enumerate(self._active):
            if self._level[channel] and not (counts and counts[0][0] == 0):
                self._set_level(channel, False, t)

    def _next_change(self) -> float:
        pending = self._queue[0][0] if self._queue else NEVER
        if not self._running or self._blocked:
            return pending
        frame = self._frame
        count = self._count
        now = self._t
        edges = [frame + c * count for counts in self._active for pair in counts for c in pair]
        later = [e for e in edges if e > now]
        return min(pending, frame + 4096 * count, *later) if later else min(
            pending, frame + 4096 * count)

    # -- pin stage ---------------------------------------------------------

    def _set_level(self, channel: int, level: bool, t: float) -> None:
        self._level[channel] = level
        self._drive(channel, t)

    def _refresh_pins(self) -> None:
        for channel in range(16):
            self._drive(channel, self._t)

    def _drive(self, channel: int, t: float) -> None:
        """Set the pin by its level, INVRT, and OUTNE while /OE is high; high-Z counts as low."""
        mode = self._mode2
        if self._oe:
            pin = mode & 0x03 == 0x01 and bool(mode & 0x04)
        else:
            pin = self._level[channel] != bool(mode & 0x10)
        rise = self._rise[channel]
        if pin and rise is None:
            self._rise[channel] = t
        elif not pin and rise is not None:
            self._rise[channel] = None
            if t > rise:
                self._done[channel].append((rise, t))
