"""Driver of the PCA9685: from any state to neutral pulses, and the pulses of each frame.

The chip has no time-out: it repeats its last pulse until it is written or loses power, and waking
it can restart an old pulse. Therefore the registers contain neutral, or "all off" while the
prescale is wrong, before any write that can wake the oscillator. MODE1 and PRE_SCALE are only
written where they differ.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from dart_hal.core.errors import BusError, NotPca, PcaFault, PcaMissing
from dart_hal.core.ports import Bus
from dart_hal.core.ports.bus import NACK, bus_name, explain
from dart_hal.devices.actuation.quantiser import (
    COUNTS_PER_FRAME,
    NOMINAL_HZ,
    count_us,
    prescale_for,
)
from dart_hal.devices.actuation.servokit import (
    MODE1,
    MODE2,
    PRE_SCALE,
    SLEEP,
    WAKE_TIME,
    Shield,
    lock,
    make_kit,
)

T = TypeVar("T")

# Bits of MODE1.
AUTO_INCREMENT = 0x20
EXTCLK = 0x40
# Bits of MODE1 by which the chip answers further addresses: SUB1 to SUB3 and all-call, which is on
# at power-on. With one of them set, data for another chip at 0x70 become pulses of this car.
ALIASES = 0x0F
# MODE2: totem pole, not inverted, outputs change at STOP, low while /OE is high.
MODE2_NORMAL = 0x04
ALL_LED_OFF_H = 0xFD
FULL_OFF = 0x10
# Attempts of a transfer before its error is raised.
MAX_ATTEMPTS = 3
# PWM frames of neutral, 0.2 s, before the pulses end: an ESC needs some of them to stop the motor.
# No more, since the neutral may be wrong. Driver, guard and standby write the same number.
NEUTRAL_FRAMES = 10
# Successful writes of guard and standby after the driver is gone: one second, neutral and then off.
FINAL_WRITES = 50
# s that ServoKit waits for the oscillator after a new prescale.
PRESCALE_SETTLE_TIME = 0.005
# Registers: the first of four per channel, and the sub-addresses with the all-call address.
LED0 = 0x06
SUBADDRESSES = range(0x02, 0x06)
# Sub-addresses and all-call address after power-on.
FURTHER_ADDRESSES = b"\xe2\xe4\xe8\xe0"
# Limit of the chip, by its data sheet.
LOWEST_PRESCALE = 3
# Register and value by which power monitors of Texas Instruments identify themselves.
TI_ID_REGISTER = 0xFE
TI_ID = b"\x54\x49"


class Pca9685:
    """One PCA9685 that drives a servo and an ESC.

    ``channels`` (steering, throttle); ``sleep``: in the backend's clock. All methods raise BusError
    after two retries.
    """

    def __init__(self, bus: Bus, *, address: int, frequency: float, channels: tuple[int, int],
                 sleep: Callable[[float], None], oscillator_hz: float = NOMINAL_HZ) -> None:
        self.address = address
        self.channels = channels
        self.prescale = prescale_for(frequency, oscillator_hz)
        self.count_us = count_us(self.prescale, oscillator_hz)
        self.frame = COUNTS_PER_FRAME * self.count_us * 1e-6
        """One PWM frame [s]."""
        self.retries = 0
        self._bus = bus
        self._sleep = sleep
        self._kit: Any = None
        self.recognised = False
        """Whether its registers have been found to be those of a PCA9685."""
        self._written: dict[int, bytes] = {}

    def open(self, neutral: tuple[int, int]) -> None:
        """Bring the chip to ``neutral`` counts from any state.

        Apart from the frame in progress at the first write, no pulse is longer than neutral.
        Raises PcaMissing, NotPca, PcaFault, BusError.
        """
        self._written.clear()
        # 1. Check by reading that the device is a PCA9685 with its internal clock.
        mode1, mode2, prescale = self._identify()
        if mode1 & EXTCLK:
            raise PcaFault("the PCA9685 runs on an external clock", found=f"MODE1 {mode1:#04x}",
                           expected="bit 6 clear", remedy="switch the board's power off and on")
        # 2. Let it answer its own address only, and set the output mode.
        self._register(MODE1, (mode1 & 0x7F & ~ALIASES) | AUTO_INCREMENT)
        for register, address in zip(SUBADDRESSES, FURTHER_ADDRESSES, strict=True):
            if self._read(register) != address:
                self._register(register, address)
        if mode2 & 0x1F != MODE2_NORMAL:
            self._register(MODE2, MODE2_NORMAL)
        # 3. Replace the pulses by neutral, without a break if the prescale is right. Read back.
        if prescale == self.prescale:
            self._take_over(mode1, neutral)
        else:
            self._set_up(prescale, neutral)
        self.check()

    def write(self, counts: tuple[int, int]) -> None:
        """Write the pulses of (steering, throttle) in counts, in one transfer if adjacent."""
        first, second = self.channels
        pulses = dict(zip(self.channels, counts, strict=True))
        if abs(first - second) == 1:
            low = min(pulses)
            self._write_leds(low, _pulse(pulses[low]) + _pulse(pulses[low + 1]))
        else:
            self._write_leds(second, _pulse(pulses[second]))
            self._write_leds(first, _pulse(pulses[first]))

    def write_channel(self, channel: int, counts: int | None) -> None:
        """Write a pulse to a spare channel (to measure the clock); None = off.

        Raises ValueError for the channels of servo and ESC.
        """
        if channel in self.channels:
            raise ValueError(f"channel {channel} drives the car; use write()")
        self._write_leds(channel, _OFF if counts is None else _pulse(counts))

    def all_off(self) -> None:
        """End the pulses of all channels by one 2-byte write. The ESC detects signal loss."""
        self._register(ALL_LED_OFF_H, FULL_OFF)

    def is_off(self) -> bool:
        """Return whether neither servo nor ESC gets a pulse; False if the chip does not answer."""
        try:
            return all(self._read(LED0 + 4 * channel + 3) & FULL_OFF for channel in self.channels)
        except BusError:
            return False

    def rest(self, throttle: int) -> bool:
        """Write ``throttle`` counts without owning the chip and without waking it.

        Channels without pulses stay off. Returns False if the settings of the chip differ or cannot
        be read: its counts may have another length, so all channels are switched off. Raises NotPca
        (nothing was written), BusError.
        """
        try:
            mode1, prescale = self._read(MODE1), self._read(PRE_SCALE)
            if not self.recognised:
                self._recognise(mode1, self._read(MODE2), prescale)
        except NotPca:
            raise
        except BusError:
            mode1 = prescale = 0
        ours = prescale == self.prescale and mode1 & (AUTO_INCREMENT | EXTCLK) == AUTO_INCREMENT
        if mode1 & ALIASES and self.recognised:
            self._register(MODE1, mode1 & (AUTO_INCREMENT | SLEEP))
        if ours and not self.is_off():
            self._write_leds(self.channels[1], _pulse(throttle))
        else:
            self.all_off()
        return ours

    def pulse_counts(self, channel: int) -> int:
        """Return the counts for which a channel is high, by its registers; 0 = off.

        Raises BusError.
        """
        on_high, low, high = (self._read(LED0 + 4 * channel + k) for k in (1, 2, 3))
        if high & FULL_OFF:
            return 0
        return COUNTS_PER_FRAME if on_high & FULL_OFF else (high << 8 | low) & 0xFFF

    def check(self, *, pulses: bool = True) -> None:
        """Read back every register that decides the chip's addresses and outputs.

        MODE1, MODE2, the further addresses, PRE_SCALE and the ``pulses`` of servo and ESC. Call it
        *before* a write, which would overwrite what another program has written since the last
        one. Raises PcaFault if a register differs from what this driver has written.
        """
        mode1, mode2, *addresses = self._read_many(MODE1, 2 + len(SUBADDRESSES))
        prescale = self._read(PRE_SCALE)
        if mode1 & (SLEEP | AUTO_INCREMENT | EXTCLK | ALIASES) != AUTO_INCREMENT \
                or mode2 & 0x1F != MODE2_NORMAL or bytes(addresses) != FURTHER_ADDRESSES \
                or prescale != self.prescale:
            fault = PcaFault(
                f"the PCA9685 at {self.address:#04x} lost its settings",
                found=f"MODE1 {mode1:#04x}, MODE2 {mode2:#04x}, registers 2 to 5 "
                      f"{bytes(addresses).hex(' ')}, PRE_SCALE {prescale:#04x}",
                expected=f"MODE1 0x20, MODE2 0x04, registers 2 to 5 {FURTHER_ADDRESSES.hex(' ')}, "
                         f"PRE_SCALE {self.prescale:#04x}",
                likely="a voltage dip of its supply, or another program that writes to it",
                remedy="check the 3.3 V supply of the board; end other programs on the bus; "
                       "dart-hal doctor")
            fault.part = "mode" if prescale == self.prescale else "prescale"
            raise fault
        if pulses and all(channel in self._written for channel in self.channels):
            self._compare(*sorted(self.channels))

    def _compare(self, low: int, high: int) -> None:
        """Compare both pulses with those that were written, by one read if adjacent."""
        if high - low == 1:
            found = self._read_many(LED0 + 4 * low, 8)
        else:
            found = b"".join(self._read_many(LED0 + 4 * k, 4) for k in (low, high))
        for channel, led in ((low, found[:4]), (high, found[4:])):
            ours = self._written[channel]
            if led != ours:
                raise PcaFault(
                    f"another program writes to the PCA9685 at {self.address:#04x}",
                    found=f"channel {channel}: {led.hex(' ')}, {self._length(led)}",
                    expected=f"{ours.hex(' ')}, {self._length(ours)}, as it was written",
                    likely="a second program that does not lock the chip",
                    remedy="end it: sudo fuser -v /dev/i2c-* lists the programs that use a bus")

    def _length(self, led: bytes) -> str:
        """Return the pulse of four LED registers as text."""
        counts = 0 if led[3] & FULL_OFF else (led[3] << 8 | led[2]) & 0xFFF
        return f"{counts * self.count_us:.0f} us"

    def _identify(self) -> tuple[int, int, int | None]:
        """Read MODE1, MODE2, PRE_SCALE; check the device. Raises PcaMissing, NotPca, BusError."""
        # One by one: without auto-increment, a burst reads one register repeatedly.
        try:
            mode1, mode2 = self._read(MODE1), self._read(MODE2)
        except BusError as error:
            if error.errno in NACK:
                raise self._missing() from error
            raise
        prescale = None
        with suppress(BusError):
            prescale = self._read(PRE_SCALE)
        self._recognise(mode1, mode2, prescale)
        return mode1, mode2, prescale

    def _recognise(self, mode1: int, mode2: int, prescale: int | None) -> None:
        """Check by reading alone that the device is a PCA9685. Raises NotPca, BusError.

        1. Its registers have one byte each. A longer read continues with the next register if
           auto-increment is on, and repeats the same register otherwise. Devices with 16-bit
           registers do neither.
        2. The four sub-addresses are even (power-on: E2 E4 E8 E0) and not all the same.
        3. MODE2 has five bits, PRE_SCALE is at least 3.
        """
        single = bytes(self._read(register) for register in SUBADDRESSES)
        burst = self._read_many(SUBADDRESSES[0], len(single))
        expected = single if mode1 & AUTO_INCREMENT else single[:1] * len(single)
        even = not any(byte & 1 for byte in single)
        if (burst != expected or not even or len(set(single)) == 1 or mode2 > 0x1F
                or (prescale is not None and prescale < LOWEST_PRESCALE)):
            monitor = self._read_many(TI_ID_REGISTER, len(TI_ID)) == TI_ID
            raise NotPca(
                f"the device at {self.address:#04x} on {bus_name(self._bus)} is no PCA9685",
                found=("a power monitor of Texas Instruments" if monitor else
                       f"registers 0 to 5: {bytes([mode1, mode2]).hex(' ')} {single.hex(' ')}")
                + "; nothing was written to it",
                expected="registers 2 to 5: e2 e4 e8 e0, or others that are even")
        self.recognised = True

    def _take_over(self, mode1: int, neutral: tuple[int, int]) -> None:
        """Replace the pulses by neutral while they run: the prescale is right."""
        self._kit = None
        # With OCH = 0 this write also clears a pending RESTART.
        self.write(neutral)
        for channel in range(16):
            if channel not in self.channels:
                self._write_leds(channel, _OFF)
        self._attach(keep=True)
        if mode1 & SLEEP:
            self._register(MODE1, AUTO_INCREMENT)
            self._sleep(WAKE_TIME)

    def _set_up(self, prescale: int | None, neutral: tuple[int, int]) -> None:
        """Set a new prescale with all pulses off: at the old one, 307 counts could be 3 ms."""
        self._kit = None
        self.all_off()
        # Wait for the end of the frame in progress; with a slow oscillator it is longer.
        old_prescale = 0xFF if prescale is None else prescale
        self._sleep(1.1 * COUNTS_PER_FRAME * count_us(old_prescale, NOMINAL_HZ) * 1e-6)
        self._attach(keep=False)
        self._sleep(PRESCALE_SETTLE_TIME)
        self.write(neutral)

    def _attach(self, keep: bool) -> None:
        """Create the ServoKit of this chip; keep: without its writes to MODE1 and PRE_SCALE."""
        shield = Shield(self._bus, self.address, keep, self._sleep)
        try:
            self._kit = make_kit(shield, self.address, self.prescale)
        except OSError as error:
            raise explain(error, self.address, bus_name(self._bus)) from error
        except ValueError as error:                     # Adafruit's probe: no answer
            raise self._missing() from error
        shield.keep = True                              # a later deinit() must not stop the chip

    def _write_leds(self, channel: int, data: bytes) -> None:
        """Write the registers of one or two channels from ``channel`` on, four bytes each."""
        self._send(bytes([LED0 + 4 * channel]) + data)
        for k in range(0, len(data), 4):
            self._written[channel + k // 4] = data[k:k + 4]

    def _register(self, register: int, value: int) -> None:
        """Write one register without ServoKit."""
        self._write_bytes(bytes([register, value]))

    def _write_bytes(self, data: bytes) -> None:
        self._retry(lambda: self._transfer_locked(lambda: self._bus.writeto(self.address, data)))

    def _send(self, data: bytes) -> None:
        """Write through ServoKit's device, or without it before it exists."""
        if self._kit is None:
            self._write_bytes(data)
        else:
            self._retry(lambda: self._through_kit(data))

    def _through_kit(self, data: bytes) -> None:
        with self._kit._pca.i2c_device as device:
            device.write(data)

    def _read(self, register: int) -> int:
        return self._read_many(register, 1)[0]

    def _read_many(self, register: int, n: int) -> bytes:
        buffer = bytearray(n)
        self._retry(lambda: self._transfer_locked(lambda: self._bus.writeto_then_readfrom(
            self.address, bytes([register]), buffer)))
        return bytes(buffer)

    def _transfer_locked(self, transfer: Callable[[], T]) -> T:
        """Make a transfer while the bus is locked. Raises BusError if it stays locked."""
        lock(self._bus, self._sleep)
        try:
            return transfer()
        finally:
            self._bus.unlock()

    def _retry(self, transfer: Callable[[], T]) -> T:
        """Repeat a transfer that fails, up to MAX_ATTEMPTS in total. Raises BusError."""
        for attempt in range(MAX_ATTEMPTS):
            try:
                return transfer()
            except OSError as error:
                if attempt == MAX_ATTEMPTS - 1:
                    raise explain(error, self.address, bus_name(self._bus)) from error
                self.retries += 1
        raise AssertionError("unreachable")

    def _missing(self) -> PcaMissing:
        """Return the error for a chip that does not answer, with the devices that do."""
        try:
            found = self._transfer_locked(self._bus.scan)
        except OSError:
            found = []
        names = ", ".join(f"{a:#04x}{_GUESS.get(a, '')}" for a in found) or "no device at all"
        return PcaMissing(f"no PCA9685 at {self.address:#04x} on {bus_name(self._bus)}",
                          found=names)


_OFF = bytes([0, 0, 0, FULL_OFF])
_GUESS = {0x28: " (BNO055?)", 0x29: " (BNO055?)", 0x3C: " (display?)",
          0x70: " (PCA9685 all-call at its default)"}


def _pulse(counts: int) -> bytes:
    """Return the registers of a pulse: ON at 0, OFF at ``counts`` (1..4095); 0 = no pulse."""
    return bytes([0, 0, counts & 0xFF, counts >> 8]) if counts else _OFF
