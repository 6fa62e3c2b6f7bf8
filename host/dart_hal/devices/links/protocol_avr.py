"""The emulator as a port of pyserial: ``serial.serial_for_url("avr://default")``.

pyserial finds it once `dart_hal.devices.links` is imported. Time is virtual: it passes while `read`
waits, not while the program computes. Reading ``in_waiting`` of an empty buffer lets one
millisecond pass, so that polling loops advance. Opening the port and raising DTR reset the Nano, as
on the real board.
"""

from __future__ import annotations

from typing import Any

from serial.serialutil import (  # type: ignore[import-untyped, unused-ignore]
    PortNotOpenError,
    SerialBase,
    SerialException,
)

from dart_hal.core.errors import DartHalError
from dart_hal.core.url import Url
from dart_hal.devices.links.avr import open_nano
from dart_hal.devices.links.emulator import EmulatedNano

# Virtual time [s] that passes when ``in_waiting`` is read with an empty buffer.
POLL_TIME = 0.001

# Virtual seconds without a byte after which a read without time-out raises an error.
MAX_SILENT_READ = 60.0


class Serial(SerialBase):  # type: ignore[misc, unused-ignore]
    """An emulated Nano behind pyserial's interface, in virtual time."""

    is_open: bool
    BAUDRATES = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 500000, 1000000, 2000000)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._nano: EmulatedNano | None = None
        self._buffer = bytearray()
        self._sent_until = 0.0
        self._dtr_line = True
        super().__init__(*args, **kwargs)

    @property
    def nano(self) -> EmulatedNano:
        """The emulated Nano, for its wheel and its faults. Raises PortNotOpenError."""
        if self._nano is None or not self.is_open:
            raise PortNotOpenError
        return self._nano

    def open(self) -> None:
        """Power the Nano at the first open, reset it at later ones. Raises SerialException."""
        if self.is_open:
            raise SerialException("Port is already open.")
        if self._port is None:
            raise SerialException("Port must be configured before it can be used.")
        if self._nano is None:
            try:
                self._nano = open_nano(Url.parse(self._port))
            except DartHalError as error:
                raise SerialException(str(error)) from error
        else:
            self._nano.reset("external")
        self._buffer.clear()
        self.is_open = True
        self._reconfigure_port()

    def close(self) -> None:
        """The Nano keeps its EEPROM for the next open."""
        self.is_open = False

    def _reconfigure_port(self) -> None:
        if self._nano is not None and self.is_open:
            self._nano.set_baud(self._baudrate)

    @property
    def in_waiting(self) -> int:
        if not self._buffer:
            self._advance(POLL_TIME)
        return len(self._buffer)

    def read(self, size: int = 1) -> bytes:
        """Read up to ``size`` bytes, fewer if the time-out [virtual s] passes first."""
        nano = self.nano
        deadline = nano.now + (MAX_SILENT_READ if self._timeout is None else self._timeout)
        while len(self._buffer) < size and nano.now < deadline:
            before = len(self._buffer)
            self._advance(deadline - nano.now)
            if self._timeout is None and len(self._buffer) > before:
                deadline = nano.now + MAX_SILENT_READ
        if self._timeout is None and len(self._buffer) < size:
            raise SerialException(
                f"no byte for {MAX_SILENT_READ:g} s of virtual time; set a timeout")
        data = bytes(self._buffer[:size])
        del self._buffer[:size]
        return data

    def write(self, b: Any) -> int:
        data = bytes(b)
        nano = self.nano
        nano.write(data)
        self._sent_until = max(self._sent_until, nano.now) + 10 * len(data) / self._baudrate
        return len(data)

    def flush(self) -> None:
        """Let the time pass in which the written bytes are sent."""
        self._advance(self._sent_until - self.nano.now)

    def reset_input_buffer(self) -> None:
        self.nano.read()
        self._buffer.clear()

    def reset_output_buffer(self) -> None:
        """Do nothing: written bytes are not buffered."""

    def _advance(self, seconds: float) -> None:
        nano = self.nano
        until = nano.now + max(0.0, seconds)
        nano.run(until)
        for data, _ in nano.read():
            self._buffer += data

    def _update_dtr_state(self) -> None:
        """DTR is coupled to RESET: its assertion restarts the Nano."""
        if self._dtr_state and not self._dtr_line and self._nano is not None:
            self._nano.reset("external")
        self._dtr_line = self._dtr_state

    def _update_rts_state(self) -> None: ...
    def _update_break_state(self) -> None: ...

    @property
    def cts(self) -> bool:
        return True

    @property
    def dsr(self) -> bool:
        return True

    @property
    def ri(self) -> bool:
        return False

    @property
    def cd(self) -> bool:
        return True
