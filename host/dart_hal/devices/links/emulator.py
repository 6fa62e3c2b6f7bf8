"""An Arduino Nano with the real firmware, emulated in process.

`EmulatedNano` runs a flash image in simavr through the C bridge, with models of the UART line, of
the BNO055's registers and of two encoder rings. World time starts at 0 s and passes only in `run`.
"""

from __future__ import annotations

import ctypes as c
import os
from collections.abc import Sequence
from types import TracebackType
from typing import Any, NamedTuple

from dart_hal.core.errors import EmulatorMissing, LinkLost, UsageError
from dart_hal.devices.links import bridge
from dart_hal.devices.links.boot import BootWait
from dart_hal.devices.links.image import (
    BOOT_START,
    FLASH_SIZE,
    find_image,
    load_image,
    with_bootloader,
)

# Nominal clock of the Nano [Hz].
F_CPU = 16_000_000

EEPROM_SIZE = 1024
RESET_CAUSES = {"external": 0, "power": 1, "brownout": 2, "watchdog": 3}
I2C_FAULTS = {"ok": 0, "nack": 1, "sda": 2, "scl": 3, "dead": 4}
IMU_FAULTS = {"ok": 0, "off": 1, "stuck": 2, "garbage": 3, "wrong": 4, "slow": 5, "delayed": 6,
              "intermittent": 7, "zero": 8}
PINS = {"D4": ("D", 4), "D5": ("D", 5), "D6": ("D", 6), "D7": ("D", 7), "D8": ("B", 0),
        "D9": ("B", 1), "D10": ("B", 2), "D11": ("B", 3), "D12": ("B", 4), "D13": ("B", 5),
        "SDA": ("C", 4), "SCL": ("C", 5)}
_PIN_NAMES = {(ord(port) - ord("B")) << 4 | bit: name for name, (port, bit) in PINS.items()}
_LEVEL = (0, 1, None)

# Bits of the result of emu_run and emu_step.
_DELIMITER = 1
_CRASHED = 2
_BYTES = 8
_BUFFER = 4096


class PinEdge(NamedTuple):
    """Change of a pin: world time [s], name, level (None = no longer driven)."""

    t: float
    pin: str
    level: int | None


class IsrStat(NamedTuple):
    """Cycles of an interrupt routine, with 4 for entry and 4 for reti."""

    n: int
    min: int
    max: int
    total: int


class UartStats(NamedTuple):
    """baud of the MCU; bytes it received, lost by overrun, garbled (both ways), sent."""

    baud: float
    received: int
    overrun: int
    garbled: int
    sent: int


def _choice(table: dict[str, int], name: str, what: str) -> int:
    if name not in table:
        raise UsageError(f"{what} {name!r} does not exist", expected=", ".join(table))
    return table[name]


class _Closed:
    """Replaces the bridge after `close`: a call must not access freed memory."""

    def __getattr__(self, name: str) -> Any:
        raise LinkLost("the emulated Nano was closed")


class EmulatedNano:
    """A Nano in simavr; implements the protocol that the simulator drives.

    ``image``: path of a .elf or .hex, the flash bytes from address 0, or None
    for `find_image()`. ``clock_error`` e: the MCU runs 16e6 (1 + e) cycles per
    world second. ``eeprom``: up to 1024 bytes. ``bootloader``: add ATmegaBOOT
    and start there, as a Nano does (an image of b"" is a board never flashed).
    Raises EmulatorMissing. Not for use from two threads at once.
    """

    def __init__(self, image: str | os.PathLike[str] | bytes | None = None, *,
                 clock_error: float = 0.0, eeprom: bytes | None = None,
                 host_baud: float = 500_000, bootloader: bool = False) -> None:
        self._lib: Any = bridge.load()
        self.image = image if isinstance(image, bytes) else load_image(image or find_image())
        if bootloader:
            self.image = with_bootloader(self.image)
        self._emu = self._lib.emu_new(self.image, len(self.image), BOOT_START if bootloader else 0)
        if not self._emu:
            raise EmulatorMissing(f"simavr refused an image of {len(self.image)} bytes",
                                  expected=f"at most {FLASH_SIZE} bytes and simavr's atmega328p")
        self.now = 0.0
        self.crashed = False
        self._hz = float(F_CPU)
        self._base_t = 0.0
        self._base_cycle = 0
        self._in = (c.c_double * 7)()
        self._staged = self._bytes = False
        self._buf = (c.c_uint8 * _BUFFER)()
        self._stamp = (c.c_uint64 * _BUFFER)()
        if clock_error:
            self.set_clock_error(clock_error)
        self.set_baud(host_baud)
        if eeprom is not None:
            self.eeprom = eeprom

    def __enter__(self) -> EmulatedNano:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Free the emulator; further calls raise LinkLost."""
        emu = getattr(self, "_emu", None)
        self._emu = None
        if emu:
            self._lib.emu_free(emu)
            self._lib = _Closed()

    # --- time ---------------------------------------------------------------

    def run(self, until: float) -> bool:
        """Advance to world time ``until`` [s], at most past one 0x00 of the UART.

        Returns True if it stopped at the end of that byte's stop bit; ``now`` is then its time.
        """
        target = self._base_cycle + int((until - self._base_t) * self._hz + 0.5)
        if self._staged:
            self._staged = False
            result = self._lib.emu_step(self._emu, target, self._in)
        else:
            result = self._lib.emu_run(self._emu, target)
        self.crashed = bool(result & _CRASHED)
        self._bytes = bool(result & _BYTES)
        if result & _DELIMITER:
            self.now = self._world(self._lib.emu_now(self._emu))
            return True
        self.now = max(self.now, until)
        return False

    def set_clock_error(self, error: float) -> None:
        """Set the clock of the MCU to 16e6 (1 + error) cycles per world second."""
        self._base_cycle = self._lib.emu_now(self._emu)
        self._base_t = self.now
        self._hz = F_CPU * (1.0 + error)
        self._lib.emu_clock(self._emu, self._hz)

    @property
    def cycle(self) -> int:
        """MCU cycles since the start; a reset does not clear them."""
        return int(self._lib.emu_now(self._emu))

    def _world(self, cycle: int) -> float:
        return self._base_t + (cycle - self._base_cycle) / self._hz

    # --- the line -----------------------------------------------------------

    def read(self) -> list[tuple[bytes, float]]:
        """Return the bytes whose stop bit has passed, in chunks that end after a 0x00, with the
        world time [s] of their last byte."""
        chunks: list[tuple[bytes, float]] = []
        while self._bytes:
            n = self._lib.emu_uart_read(self._emu, self._buf, self._stamp, _BUFFER)
            self._bytes = n == _BUFFER
            data = bytes(memoryview(self._buf)[:n])
            start = 0
            while start < n:
                end = data.find(0, start) + 1 or n
                chunks.append((data[start:end], self._world(self._stamp[end - 1])))
                start = end
        return chunks

    def write(self, data: bytes) -> None:
        """Send bytes to the Nano from now on, one per 10 bit times."""
        self._lib.emu_uart_write(self._emu, bytes(data), len(data))

    def set_baud(self, host_baud: float) -> None:
        """Set the line rate of the host; with more than 4 % difference both sides read noise."""
        self._lib.emu_uart_baud(self._emu, host_baud)

    # --- the world ----------------------------------------------------------

    def set_ring(self, ring: int, marks: Sequence[float]) -> None:
        """Set the edges of ring 0 (D2) or 1 (D3), in revolutions of the main gear, in [0, 1).

        Sorted, an even number; none = a sensor without a ring. A missing mark is left out. Raises
        UsageError.
        """
        table = (c.c_double * max(1, len(marks)))(*marks)
        if self._lib.emu_ring(self._emu, ring, table, len(marks)):
            raise UsageError(f"ring {ring} cannot have these {len(marks)} marks",
                             expected="ring 0 or 1, an even number of at most 128 marks, "
                                      "sorted and different, in [0, 1)")

    def set_wheel(self, rev_per_s: float) -> None:
        """Set the rate of the main gear [rev/s], signed; the phase is continuous."""
        self._in[0] = rev_per_s
        self._staged = True

    def set_imu(self, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        """Set angular rate [rad/s] and acceleration without gravity [m/s2] in sensor axes."""
        self._in[1], self._in[2], self._in[3] = gyro
        self._in[4], self._in[5], self._in[6] = lin_acc
        self._staged = True

    def set_imu_errors(self, gyro: Sequence[float] = (0, 0, 0), acc: Sequence[float] = (0, 0, 0),
                       clock: float = 0.0037,
                       calibrated_after: Sequence[float] = (2.0, 1.0, 4.0)) -> None:
        """Set the offsets [rad/s], [m/s2] and the relative clock error of the BNO055, and the
        seconds in a fusion mode until its sys, gyr and acc levels are 3 (negative: never)."""
        self._lib.emu_imu_setup(self._emu, (c.c_double * 10)(*gyro, *acc, clock,
                                                              *calibrated_after))

    # --- resets and faults --------------------------------------------------

    def reset(self, cause: str = "external") -> None:
        """Restart the MCU: external, power, brownout or watchdog. Raises UsageError."""
        self._lib.emu_reset(self._emu, _choice(RESET_CAUSES, cause, "reset cause"))
        self.crashed = False

    def set_boot(self, wait: BootWait) -> None:
        """Set the times between a reset and the program, from the next reset on."""
        self._lib.emu_boot(self._emu, (c.c_double * 4)(*wait))

    def set_i2c(self, fault: str = "ok", p: float = 1.0, stretch_us: float = 180.0,
                clocks: int = 9) -> None:
        """Set the fault of the bus: ok, nack (share ``p``), sda or scl constantly low, dead.

        ``stretch_us`` per byte; ``clocks``: SCL pulses driven by GPIO that release SDA (0 =
        never). Raises UsageError.
        """
        self._lib.emu_i2c(self._emu, _choice(I2C_FAULTS, fault, "I2C fault"), p, stretch_us,
                          clocks)

    def set_imu_fault(self, fault: str = "ok", value: float = 1.0) -> None:
        """Set the fault of the BNO055, one of `IMU_FAULTS`. Raises UsageError.

        ``value``: for wrong, the gain of its measurements; slow, updates per second; delayed, s (at
        most 1.2); intermittent, the share of addresses that it does not acknowledge.
        """
        self._lib.emu_imu_fault(self._emu, _choice(IMU_FAULTS, fault, "IMU fault"), value)

    def reset_imu(self) -> None:
        """Restart the BNO055: 650 ms without ACK, registers lost."""
        self._lib.emu_imu_reset(self._emu)

    def config_imu(self) -> None:
        """The BNO055 falls back to CONFIG without a gap: registers lost, data 0."""
        self._lib.emu_imu_config(self._emu)

    def set_chatter(self, ring: int, rate: float, irregular: bool = False) -> None:
        """Electrical noise on D2 (ring 0) or D3: ``rate`` edges/s (0: none), evenly spaced or
        at random. Raises UsageError above 2e6."""
        if self._lib.emu_chatter(self._emu, ring, rate, irregular):
            raise UsageError(f"ring {ring} cannot chatter at {rate:g} edges/s",
                             expected="ring 0 or 1, at most 2e6 edges/s")

    def freeze(self, on: bool = True) -> None:
        """Stop the program with interrupts off, until a reset; timers, their pins and the
        watchdog continue."""
        self._lib.emu_freeze(self._emu, on)

    def hang(self, on: bool = True) -> None:
        """Stop the main program until a reset; interrupts run."""
        self._lib.emu_hang(self._emu, on)

    def set_vcc(self, volt: float) -> None:
        """Set the supply [V] that the ADC measures; below 2.7 the brown-out detector resets."""
        self._lib.emu_vcc(self._emu, round(1000 * volt))

    def set_power(self, on: bool) -> None:
        """Switch the supply on or off, as by the USB cable: off, no pin is driven, RAM is lost."""
        self._lib.emu_power(self._emu, on)

    def tear_eeprom(self, nth: int = 1) -> None:
        """Let the supply fail while the ``nth`` byte from now on is written: the byte is garbled,
        and a brown-out resets the MCU (0: no failure)."""
        self._lib.emu_eeprom_tear(self._emu, nth)

    # --- inspection ---------------------------------------------------------

    @property
    def eeprom(self) -> bytes:
        """The 1024 bytes of the EEPROM; assign to replace the first ones."""
        buf = (c.c_uint8 * EEPROM_SIZE)()
        self._lib.emu_eeprom_get(self._emu, buf, EEPROM_SIZE)
        return bytes(buf)

    @eeprom.setter
    def eeprom(self, data: bytes) -> None:
        if self._lib.emu_eeprom_set(self._emu, bytes(data), len(data)) < 0:
            raise UsageError(f"{len(data)} bytes do not fit the EEPROM",
                             expected=f"at most {EEPROM_SIZE}")

    @property
    def flash(self) -> bytes:
        """The present 32 KiB of flash."""
        buf = (c.c_uint8 * FLASH_SIZE)()
        self._lib.emu_flash_get(self._emu, buf, FLASH_SIZE)
        return bytes(buf)

    def pins(self) -> dict[str, int | None]:
        """Return the level that the MCU drives at each pin of `PINS`; None = input."""
        return {name: _LEVEL[self._lib.emu_pin_state(self._emu, ord(port), bit)]
                for name, (port, bit) in PINS.items()}

    def pin_log(self) -> list[PinEdge]:
        """Return the changes of driven pins since the last call (at most 8192 are stored)."""
        cycle = (c.c_uint64 * 8192)()
        pin = (c.c_uint8 * 8192)()
        state = (c.c_uint8 * 8192)()
        n = self._lib.emu_pin_log(self._emu, cycle, pin, state, 8192)
        return [PinEdge(self._world(cycle[i]), _PIN_NAMES[pin[i]], _LEVEL[state[i]])
                for i in range(n) if pin[i] in _PIN_NAMES]

    def set_pin(self, name: str, level: bool) -> None:
        """Set the external level of an input, for example "D8". Raises UsageError."""
        if name not in PINS:
            raise UsageError(f"pin {name!r} is not wired", expected=", ".join(PINS))
        port, bit = PINS[name]
        self._lib.emu_pin(self._emu, ord(port), bit, level)

    def set_divider(self, volt: float | None, ohm: float = 7500.0) -> None:
        """Set the voltage [V] at A0 behind a resistance; None: nothing is connected."""
        self._lib.emu_divider(self._emu, volt or 0.0, -1.0 if volt is None else ohm)

    def gate_capture(self, pin: str) -> None:
        """Connect D8 to the level of ``set_pin`` only while the MCU drives a pin high; "": always.

        pin: "D5" of the multiplexer, or "D6" of /OE.
        """
        self._lib.emu_capture(self._emu, int(pin[1:] or 0))

    def edges(self, ring: int = 0) -> int:
        """Return the number of level changes of ring 0 or 1 on its pin."""
        return int(self._lib.emu_edges(self._emu, ring))

    def uart_stats(self) -> UartStats:
        out = (c.c_double * 5)()
        self._lib.emu_uart_stats(self._emu, out)
        return UartStats(out[0], *(int(v) for v in out[1:]))

    def isr(self, vector: int) -> IsrStat:
        """Return the run times of interrupt vector 1..25 (1 = INT0, 12 = TIMER1_COMPB, ...)."""
        out = (c.c_uint64 * 4)()
        self._lib.emu_isr(self._emu, vector, out)
        return IsrStat(*out)

    def marks(self) -> list[tuple[int, int]]:
        """Return (cycle, value) of the program's writes to GPIOR0 since the last call."""
        cycle = (c.c_uint64 * 8192)()
        value = (c.c_uint8 * 8192)()
        n = self._lib.emu_mark(self._emu, cycle, value, 8192)
        return [(cycle[i], value[i]) for i in range(n)]

    def stack(self) -> tuple[int, int]:
        """Return the largest size [bytes] of the stack since power-on, and the unused bytes."""
        out = (c.c_uint32 * 2)()
        self._lib.emu_stack(self._emu, out)
        return out[0], out[1]

    def peek(self, address: int) -> int:
        """Return a byte of the data space (registers, I/O, RAM)."""
        return int(self._lib.emu_peek(self._emu, address))

    def poke(self, address: int, value: int) -> None:
        self._lib.emu_poke(self._emu, address, value)

    def imu_register(self, register: int) -> int:
        """Return a register of page 0 of the BNO055 model."""
        return int(self._lib.emu_imu_peek(self._emu, register))
