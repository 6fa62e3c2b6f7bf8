"""Model of the PCA9685 at register level: from register writes to pulses.

``Pca9685Model`` has the registers. Changes of the outputs are queued with the time of their STOP,
or of their fourth ACK. ``PwmOutput`` computes the (rise, fall) times of each channel from this
queue. Source: NXP PCA9685 data sheet, sections 7.3 to 7.7.

The data sheet does not say when a new OFF count acts: ``update`` is "next_frame" (default) or
"now".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dart_lab.sim.pwm_output import OscillatorHz, PwmOutput

# Registers, bits of MODE1, the bit "change on ACK" of MODE2, and the bit "full" of a count.
MODE1 = 0x00
MODE2 = 0x01
LED0 = 0x06
ALL_LED = 0xFA
PRE_SCALE = 0xFE
RESTART = 0x80
EXTCLK = 0x40
AI = 0x20
SLEEP = 0x10
ALLCALL = 0x01
OCH = 0x08
FULL_BIT = 0x10
# Start time of the oscillator after SLEEP is cleared [s].
OSCILLATOR_START = 500e-6

_RESET_VALUES = {MODE1: 0x11, MODE2: 0x04, 0x02: 0xE2, 0x03: 0xE4, 0x04: 0xE8, 0x05: 0xE0,
                 PRE_SCALE: 0x1E}


@dataclass(slots=True)
class _Transaction:
    """LED registers that one write, from START to STOP, has changed."""

    led: bool
    channels: dict[int, set[int]]


class Pca9685Model:
    """Registers of one chip at ``address``; times in s of the world.

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
        """Return whether the chip acknowledges: own, all-call or an enabled sub-address."""
        mode = self._regs[MODE1]
        aliases = ((ALLCALL, 5), (0x08, 2), (0x04, 3), (0x02, 4))
        return address == self.address or any(
            mode & bit and address == self._regs[reg] >> 1 for bit, reg in aliases)

    def write(self, data: bytes, acks: Sequence[float], stop: float) -> None:
        """Run a write transaction; ``acks[i]``: time of the ACK of the i-th data byte [s]."""
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
        """Return n bytes from the pointer on; ALL_LED registers are read as zero."""
        out = bytearray()
        for _ in range(n):
            hidden = ALL_LED <= self._pointer < PRE_SCALE
            out.append(0 if hidden else self._regs[self._pointer])
            self._advance_pointer()
        return bytes(out)

    def software_reset(self, t: float) -> None:
        """Restore the state of power-on: SWRST on the general-call address."""
        self._power_on(t)

    def brown_out(self, t: float) -> None:
        """Reset all registers by a dip of the supply, without any sign to the host."""
        self._power_on(t)

    def set_oe(self, level: bool, t: float) -> None:
        """Set the pin /OE; True = outputs disabled."""
        self.output.schedule(t, lambda: self.output.set_oe(level))

    def peek(self, register: int) -> int:
        """Return the content of a register without bus traffic, for tests."""
        return self._regs[register]

    def _power_on(self, t: float) -> None:
        self._regs = bytearray(256)
        for register, value in _RESET_VALUES.items():
            self._regs[register] = value
        for channel in range(16):
            self._regs[LED0 + 4 * channel + 3] = FULL_BIT
        self._pointer = 0
        out = self.output
        leds = self._leds(range(16))
        out.sleep(t)
        out.schedule(t, lambda: out.set_mode2(0x04))
        out.schedule(t, lambda: out.set_prescale(0x1E))
        out.schedule(t, lambda: out.latch(leds))

    def _advance_pointer(self) -> None:
        if self._regs[MODE1] & AI:
            self._pointer = 0 if self._pointer in (0x45, PRE_SCALE) else (self._pointer + 1) & 0xFF

    def _store(self, register: int, value: int, t: float, touched: _Transaction) -> None:
        if register == MODE1:
            self._store_mode1(value, t)
        elif register == MODE2:
            self._regs[MODE2] = value & 0x1F
            self.output.schedule(t, lambda: self.output.set_mode2(value))
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
            self.output.schedule(t + OSCILLATOR_START, lambda: self.output.start(blocked),
                                 wakes=True)
        stable = not old & SLEEP and t - self._awake_since >= OSCILLATOR_START - 1e-9
        if value & RESTART and restart and not value & SLEEP and stable:
            restart = 0
            self.output.schedule(t, self.output.resume)
        # EXTCLK is set only in sleep and cleared only by a power cycle or SWRST
        external = old & EXTCLK or (value & EXTCLK if old & SLEEP else 0)
        self._regs[MODE1] = (value & 0x3F) | external | restart

    def _running(self) -> bool:
        return any(not self._regs[LED0 + 4 * c + 3] & FULL_BIT for c in range(16))

    def _store_prescale(self, value: int, t: float) -> None:
        if self._regs[MODE1] & SLEEP:
            self._regs[PRE_SCALE] = max(3, value)
            self.output.schedule(t, lambda: self.output.set_prescale(max(3, value)))

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
        """Pass new counts to the outputs; a pending RESTART is cancelled."""
        leds = self._leds(channels)
        out = self.output
        out.schedule(t, lambda: out.latch(leds))
        if self._regs[MODE1] & RESTART:
            self._regs[MODE1] &= ~RESTART
            out.schedule(t, out.resume)

    def _leds(self, channels: Sequence[int]) -> dict[int, tuple[tuple[int, int], ...]]:
        return {c: high_counts(self._regs[LED0 + 4 * c: LED0 + 4 * c + 4]) for c in channels}


def high_counts(led: bytes | bytearray) -> tuple[tuple[int, int], ...]:
    """Return the intervals [from, to) of the 4096 counts in which a channel is high.

    ``led``: ON_L, ON_H, OFF_L, OFF_H. Full off wins over full on; OFF < ON
    wraps into the next frame; equal counts are low.
    """
    if led[3] & FULL_BIT:
        return ()
    if led[1] & FULL_BIT:
        return ((0, 4096),)
    on = led[0] | (led[1] & 0x0F) << 8
    off = led[2] | (led[3] & 0x0F) << 8
    if on < off:
        return ((on, off),)
    if on > off:
        return ((0, off), (on, 4096)) if off else ((on, 4096),)
    return ()


