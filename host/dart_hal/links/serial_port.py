"""A real Nano on a serial port, and the PCA9685 on the host's I2C bus.

``serial:///dev/ttyUSB0?i2c=1``      port by name, I2C bus 1
``hwgrep://1A86:7523?i2c=1``         port by USB id or description
``serial:///dev/pts/3?i2c=unix:/p``  a simulated car served by ``dart-hal sim``

Opening a port resets the Nano (DTR through 100 nF to RESET): the kernel
raises DTR before user code can prevent it, so a boot is always expected.
"""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections.abc import Iterator
from pathlib import Path

import serial
from serial.tools import list_ports

from dart_hal.errors import LinkLost, PortBusy, PortDenied, PortMissing
from dart_hal.links.base import Backend, Chunk, Url
from dart_hal.links.i2c import open_bus

RATES = (500_000, 115_200)
"""Line rates to try, in this order: 0.00 % and +2.12 % error on the AVR."""

READ_SLICE = 4096


class RealClock:
    """The host's monotonic clock."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class SerialLink:
    """Blocking byte link over pyserial; one reader and one writer may use it.

    Raises PortMissing, PortBusy, PortDenied on opening; LinkLost afterwards.
    """

    rates = RATES

    def __init__(self, device: str, baud: int = RATES[0]) -> None:
        self.device = device
        self._port = serial.Serial()
        self._port.port = device
        self._port.baudrate = baud
        self._port.timeout = 0
        self._port.write_timeout = 0.5
        self._port.exclusive = True
        with contextlib.suppress(OSError, serial.SerialException):
            self._port.dtr = False
        try:
            self._port.open()
        except serial.SerialException as error:
            raise _open_error(device, error) from error
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)
        _clear_hupcl(self._port.fd)

    @property
    def baud(self) -> int:
        return int(self._port.baudrate)

    def set_baud(self, baud: int) -> None:
        """Change the line rate without closing (no reset of the Nano)."""
        self._port.baudrate = baud
        self._port.reset_input_buffer()

    def read(self, timeout: float) -> Chunk | None:
        try:
            self._port.timeout = timeout
            data = self._port.read(1)
            if data and (more := self._port.in_waiting):
                data += self._port.read(min(more, READ_SLICE))
        except (serial.SerialException, OSError, TypeError) as error:
            # TypeError: pyserial reads from a descriptor that close() set to None.
            raise LinkLost(f"{self.device} vanished", found=str(error)) from error
        return Chunk(data, time.monotonic()) if data else None

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (serial.SerialException, OSError, TypeError) as error:
            raise LinkLost(f"{self.device} does not take bytes", found=str(error)) from error

    def close(self) -> None:
        self._port.close()


def _clear_hupcl(fd: int) -> None:
    """Keep DTR when the port closes, so that the next open need not reset again."""
    import termios

    with contextlib.suppress(termios.error):
        attributes = termios.tcgetattr(fd)
        attributes[2] &= ~termios.HUPCL
        termios.tcsetattr(fd, termios.TCSANOW, attributes)


def holders(device: str) -> Iterator[tuple[int, str]]:
    """Processes that have a device open: (pid, command), as far as /proc shows."""
    real = os.path.realpath(device)
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if any(os.path.realpath(fd) == real for fd in (process / "fd").iterdir()):
                yield int(process.name), (process / "comm").read_text().strip()


def _open_error(device: str, error: serial.SerialException) -> Exception:
    """Turn pyserial's exception into the catalogue's, with the facts."""
    code = error.errno
    if code == errno.EACCES:
        return PortDenied(f"no permission to open {device}", found=str(error))
    if code in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "lock" in str(error):
        others = [f"pid {pid} ({name})" for pid, name in holders(device) if pid != os.getpid()]
        return PortBusy(f"{device} is in use", found=", ".join(others) or str(error))
    here = ", ".join(p.device for p in list_ports.comports()) or "no serial ports at all"
    return PortMissing(f"cannot open {device}", found=f"{error}; present: {here}")


def find_port(pattern: str) -> str:
    """Device whose USB id or description matches; raises PortMissing."""
    found = list(list_ports.grep(pattern))
    if found:
        return str(found[0].device)
    here = ", ".join(f"{p.device} ({p.hwid})" for p in list_ports.comports())
    raise PortMissing(f"no serial port matches {pattern!r}", found=here or "no serial ports at all",
                      expected="a CH340 is 1A86:7523, an FT232 is 0403:6001")


def open_serial(url: Url) -> Backend:
    """Entry point of ``serial://`` and ``hwgrep://``."""
    url.known("i2c", "baud")
    device = url.target if url.scheme == "serial" else find_port(url.target)
    if not device:
        raise PortMissing(f"{url.text} names no port", expected="serial:///dev/ttyUSB0?i2c=1")
    link = SerialLink(device, int(url.options.get("baud", RATES[0])))
    bus = None
    try:
        if "i2c" in url.options:
            bus = open_bus(url.options["i2c"])
    except OSError:
        link.close()
        raise
    notices = () if bus else (
        f"no I2C bus in the URL: commands are not sent (try {url.text}?i2c=1)",)
    return Backend(url=url, link=link, clock=RealClock(), bus=bus, virtual=False, notices=notices)
