"""The PCA9685 at register level: what is written, and which pulses come out.

Two halves. ``Pca9685`` is the register file that the bus sees; changes that
reach the pins are queued with the time of their STOP (or fourth ACK).
``PwmOutput`` turns the queue into (rise, fall) times per channel. Source: NXP
PCA9685 data sheet, sections 7.3 to 7.7.

Where the data sheet leaves the instant open at which a new OFF count acts,
``update`` chooses: "next_frame" (default) or "now".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dart_lab.sim.pwm_output import OscillatorHz, PwmOutput

MODE1, MODE2, LED0, ALL_LED, PRE_SCALE = 0x00, 0x01, 0x06, 0xFA, 0xFE
RESTART, EXTCLK, AI, SLEEP, ALLCALL = 0x80, 0x40, 0x20, 0x10, 0x01
OCH = 0x08
FULL = 0x10
STABLE = 500e-6
"""s that the oscillator needs after SLEEP is cleared."""

_POWER_ON = {MODE1: 0x11, MODE2: 0x04, 0x02: 0xE2, 0x03: 0xE4, 0x04: 0xE8, 0x05: 0xE0,
             PRE_SCALE: 0x1E}


@dataclass(slots=True)
class _Transaction:
    """One write from START to STOP: which LED registers it touched."""

    led: bool
    channels: dict[int, set[int]]


class Pca9685:
    """Register file of one chip at ``address``; times in s of the world.

    ``oscillator``: Hz, or a function of time for a drifting one.
    """

    def __init__(self, address: int = 0x40, oscillator: OscillatorHz = 25e6,
                 update: str = "next_frame") -> None:
        self.address = address
        self.output = PwmOutput(oscillator, update)
        self._regs = bytearray(256)
        self._pointer = 0
        self._awake_since = float("-inf")
        self._power_on(0.0)

    def answers(self, address: int) -> bool:
        """Whether the chip acknowledges: own, all-call or an enabled sub-address."""
        mode = self._regs[MODE1]
        aliases = ((ALLCALL, 5), (0x08, 2), (0x04, 3), (0x02, 4))
        return address == self.address or any(
            mode & bit and address == self._regs[reg] >> 1 for bit, reg in aliases)

    def write(self, data: bytes, acks: Sequence[float], stop: float) -> None:
        """A write transaction: ``acks[i]`` is the time of the i-th data byte's ACK."""
        if not data:
            return
        self._pointer = data[0]
        touched = _Transaction(False, {})
        for value, t in zip(data[1:], acks[1:], strict=True):
            self._store(self._pointer, value, t, touched)
            self._advance_pointer()
        if touched.led and not self._regs[MODE2] & OCH:
            self._latch(range(16), stop)

    def read(self, n: int) -> bytes:
        """n bytes from the pointer on; ALL_LED registers read zero."""
        out = bytearray()
        for _ in range(n):
            hidden = ALL_LED <= self._pointer < PRE_SCALE
            out.append(0 if hidden else self._regs[self._pointer])
            self._advance_pointer()
        return bytes(out)

    def software_reset(self, t: float) -> None:
        """SWRST on the general-call address: the state of power-on."""
        self._power_on(t)

    def brown_out(self, t: float) -> None:
        """The supply dips: every register falls back, nothing tells the host."""
        self._power_on(t)

    def set_oe(self, level: bool, t: float) -> None:
        """Pin /OE; True = outputs disabled."""
        self.output.at(t, lambda: self.output.set_oe(level))

    def peek(self, register: int) -> int:
        """A register's content without bus traffic, for tests."""
        return self._regs[register]

    def _power_on(self, t: float) -> None:
        self._regs = bytearray(256)
        for register, value in _POWER_ON.items():
            self._regs[register] = value
        for channel in range(16):
            self._regs[LED0 + 4 * channel + 3] = FULL
        self._pointer = 0
        out, leds = self.output, self._leds(range(16))
        out.sleep(t)
        out.at(t, lambda: out.set_mode2(0x04))
        out.at(t, lambda: out.set_prescale(0x1E))
        out.at(t, lambda: out.latch(leds))

    def _advance_pointer(self) -> None:
        if self._regs[MODE1] & AI:
            self._pointer = 0 if self._pointer in (0x45, PRE_SCALE) else (self._pointer + 1) & 0xFF

    def _store(self, register: int, value: int, t: float, touched: _Transaction) -> None:
        if register == MODE1:
            self._store_mode1(value, t)
        elif register == MODE2:
            self._regs[MODE2] = value & 0x1F
            self.output.at(t, lambda: self.output.set_mode2(value))
        elif register == PRE_SCALE:
            self._store_prescale(value, t)
        elif LED0 <= register <= 0x45:
            self._store_led(register, value, t, touched)
        elif ALL_LED <= register < PRE_SCALE:
            for channel in range(16):
                self._store_led(LED0 + 4 * channel + register - ALL_LED, value, t, touched)
        elif 0x02 <= register <= 0x05:
            self._regs[register] = value & 0xFE

    def _store_mode1(self, value: int, t: float) -> None:
        old = self._regs[MODE1]
        restart = old & RESTART
        if value & SLEEP and not old & SLEEP:
            restart |= RESTART if self._running() else 0
            self.output.sleep(t)
        if not value & SLEEP and old & SLEEP:
            self._awake_since = t
            blocked = bool(restart)
            self.output.at(t + STABLE, lambda: self.output.start(blocked), wakes=True)
        stable = not old & SLEEP and t - self._awake_since >= STABLE - 1e-9
        if value & RESTART and restart and not value & SLEEP and stable:
            restart = 0
            self.output.at(t, self.output.resume)
        # EXTCLK is set only in sleep and cleared only by a power cycle or SWRST
        external = old & EXTCLK or (value & EXTCLK if old & SLEEP else 0)
        self._regs[MODE1] = (value & 0x3F) | external | restart

    def _running(self) -> bool:
        return any(not self._regs[LED0 + 4 * c + 3] & FULL for c in range(16))

    def _store_prescale(self, value: int, t: float) -> None:
        if self._regs[MODE1] & SLEEP:
            self._regs[PRE_SCALE] = max(3, value)
            self.output.at(t, lambda: self.output.set_prescale(max(3, value)))

    def _store_led(self, register: int, value: int, t: float, touched: _Transaction) -> None:
        channel, part = divmod(register - LED0, 4)
        self._regs[register] = value & (0x1F if part in (1, 3) else 0xFF)
        touched.led = True
        parts = touched.channels.setdefault(channel, set())
        parts.add(part)
        if len(parts) == 4 and self._regs[MODE2] & OCH:
            parts.clear()
            self._latch((channel,), t)

    def _latch(self, channels: Sequence[int], t: float) -> None:
        """New counts reach the outputs; a pending RESTART is given up."""
        leds, out = self._leds(channels), self.output
        out.at(t, lambda: out.latch(leds))
        if self._regs[MODE1] & RESTART:
            self._regs[MODE1] &= ~RESTART
            out.at(t, out.resume)

    def _leds(self, channels: Sequence[int]) -> dict[int, tuple[tuple[int, int], ...]]:
        return {c: high_counts(self._regs[LED0 + 4 * c: LED0 + 4 * c + 4]) for c in channels}


def high_counts(led: bytes | bytearray) -> tuple[tuple[int, int], ...]:
    """Intervals [from, to) of the 4096 counts in which a channel is high.

    ``led``: ON_L, ON_H, OFF_L, OFF_H. Full off wins over full on; OFF < ON
    wraps into the next frame; equal counts are low.
    """
    if led[3] & FULL:
        return ()
    if led[1] & FULL:
        return ((0, 4096),)
    on, off = led[0] | (led[1] & 0x0F) << 8, led[2] | (led[3] & 0x0F) << 8
    if on < off:
        return ((on, off),)
    if on > off:
        return ((0, off), (on, 4096)) if off else ((on, 4096),)
    return ()


