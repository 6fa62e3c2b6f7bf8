"""A Nano on a serial port, and the PCA9685 on the computer's I2C bus.

``serial:///dev/ttyUSB0?i2c=1``      port by name, I2C bus 1
``hwgrep://1A86:7523?i2c=1``         port by USB id or description
``serial:///dev/pts/3?i2c=unix:/p``  a simulated car served by ``dart-hal sim``

Opening a port resets the Nano (DTR through 100 nF to RESET): the kernel raises DTR before user code
can prevent it, so a boot is always expected.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import serial
from serial.tools import list_ports

from dart_hal.core.errors import LinkLost, PortBusy, PortDenied, PortMissing, UsageError
from dart_hal.core.ports import Chunk, Link
from dart_hal.core.process.forks import private
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.process.waiting import wait_readable, wait_writable
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.computers import resolve_bus
from dart_hal.devices.links.i2c import SocketBus, check_bus, open_bus
from dart_hal.devices.links.smbus import SmbusBus

try:
    import fcntl
    import termios
except ImportError:  # Windows, where pyserial reads and writes without descriptors
    _TERMINAL_ERRORS: tuple[type[Exception], ...] = ()
else:
    _TERMINAL_ERRORS = (termios.error,)

# Line rates to try, in this order: 0.00 % and +2.12 % error on the AVR.
RATES = (500_000, 115_200)

READ_SLICE = 4096
# s, one PWM frame: a port that does not accept bytes must not delay the pulses.
WRITE_TIMEOUT = 0.02
# Exceptions of a port that has vanished. TypeError and ValueError: its descriptor becomes None or
# -1 in another thread. The termios functions raise their own error.
PORT_LOST_ERRORS = (serial.SerialException, OSError, TypeError, ValueError, *_TERMINAL_ERRORS)
# s between two looks at a port whose system has no descriptors to wait for.
PORT_POLL_INTERVAL = 0.001


class RealClock:
    """Time since the computer's start, including the time for which it was suspended."""

    def now(self) -> float:
        return elapsed()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


class SerialLink(Link):
    """Blocking byte link over pyserial; one reader and one writer may use it.

    Raises PortMissing, PortBusy, PortDenied, UsageError on opening; LinkLost afterwards. Bytes that
    the port does not accept within ``WRITE_TIMEOUT`` are lost, as on a bad line; the Nano detects
    this by its time-out. ``dtr``: the modem line, which resets a Nano and switches the motor of a
    lidar on.
    """

    rates = RATES
    dropped = 0
    """Frames that the port did not accept in time."""

    def __init__(self, device: str, baud: int = RATES[0], *, dtr: bool = False) -> None:
        self.device = device
        self._port = serial.Serial()
        self._port.port = device
        self._port.timeout = 0
        self._port.write_timeout = WRITE_TIMEOUT
        self._port.exclusive = True
        with contextlib.suppress(OSError, serial.SerialException):
            self._port.dtr = dtr
        try:
            self._port.baudrate = baud
            self._port.open()
        except serial.SerialException as error:
            raise _open_error(device, error) from None
        except (ValueError, OverflowError) as error:
            raise UsageError(f"{device} cannot run at {baud} baud", found=str(error),
                             expected=" or ".join(map(str, RATES))) from error
        private(self._port)
        with contextlib.suppress(OSError, ValueError, NotImplementedError, AttributeError):
            self._port.set_low_latency_mode(True)
        self._has_descriptor = hasattr(self._port, "fd")
        if self._has_descriptor:
            _configure_port(self._port.fd,
                            simulated=os.path.realpath(device).startswith("/dev/pts/"))

    @property
    def baud(self) -> int:
        return int(self._port.baudrate)

    def set_baud(self, baud: int) -> None:
        """Change the line rate without closing (no reset of the Nano). Raises LinkLost."""
        try:
            self._port.baudrate = baud
            self._port.reset_input_buffer()
        except PORT_LOST_ERRORS as error:
            raise LinkLost(f"{self.device} vanished", found=str(error)) from error

    def read(self, timeout: float) -> Chunk | None:
        # Not Serial.read with a time-out: setting it reconfigures the port each time.
        try:
            if not self._has_descriptor:
                data = self._poll_port(timeout)
                return Chunk(data, elapsed()) if data else None
            if not wait_readable(self._descriptor(), timeout):
                return None
            data = os.read(self._port.fd, READ_SLICE)
        except BlockingIOError:
            return None
        except PORT_LOST_ERRORS as error:
            raise LinkLost(f"{self.device} vanished", found=str(error)) from error
        if not data:
            raise LinkLost(f"{self.device} vanished", found="end of file")
        return Chunk(data, elapsed())

    def write(self, data: bytes) -> None:
        # Not Serial.write: it waits by select, which refuses descriptors from 1024 on.
        end = elapsed() + WRITE_TIMEOUT
        rest = memoryview(data)
        try:
            if not self._has_descriptor:
                self._port.write(data)
                return
            while rest:
                if not wait_writable(self._descriptor(), end - elapsed()):
                    self.dropped += 1
                    return
                with contextlib.suppress(BlockingIOError):
                    rest = rest[os.write(self._port.fd, rest):]
        except serial.SerialTimeoutException:
            self.dropped += 1
        except PORT_LOST_ERRORS as error:
            raise LinkLost(f"{self.device} does not take bytes", found=str(error)) from error

    def _poll_port(self, timeout: float) -> bytes:
        """Return the bytes that pyserial has received, waiting at most ``timeout`` s for one."""
        end = elapsed() + timeout
        while not self._port.in_waiting and elapsed() < end:
            time.sleep(PORT_POLL_INTERVAL)
        return bytes(self._port.read(self._port.in_waiting))

    def _descriptor(self) -> int:
        """Return that of the open port. Raises ``serial.PortNotOpenError`` for a closed one."""
        if not self._port.is_open:
            raise serial.PortNotOpenError
        return int(self._port.fd)

    def set_dtr(self, on: bool) -> None:
        """Set the modem line, which keeps its state when the port closes; a lost port is left."""
        with contextlib.suppress(*PORT_LOST_ERRORS):
            self._port.dtr = on

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()


def _configure_port(fd: int, *, simulated: bool) -> None:
    """Keep DTR when the port closes, and exclude other programs while it is open.

    With DTR kept, the next open need not reset the Nano again. After TIOCEXCL an open by another
    program fails before it raises DTR, which would reset the Nano of a driving car. A pty has no
    DTR, and would stay exclusive after its program was killed.
    """
    with contextlib.suppress(termios.error):
        attributes = termios.tcgetattr(fd)
        attributes[2] &= ~termios.HUPCL
        termios.tcsetattr(fd, termios.TCSANOW, attributes)
    if not simulated:
        with contextlib.suppress(OSError):
            fcntl.ioctl(fd, termios.TIOCEXCL)


def is_port(device: str) -> bool:
    """Return whether it may be a serial port, without opening it, which would reset the Nano.

    Memory devices (/dev/null, /dev/zero: major number 1, Linux devices.txt) are not.
    """
    if device in (port.device for port in list_ports.comports()):
        return True  # also COM3, which is no file
    if not os.path.exists(device):
        return False
    found = os.stat(device)
    return stat.S_ISCHR(found.st_mode) and os.major(found.st_rdev) != 1


def holders(device: str) -> Iterator[tuple[int, str]]:
    """Yield the processes that have a device open: (pid, command), as far as /proc shows them."""
    real = os.path.realpath(device)
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if any(os.path.realpath(fd) == real for fd in (process / "fd").iterdir()):
                yield int(process.name), (process / "comm").read_text().strip()


def _open_error(device: str, error: serial.SerialException) -> Exception:
    """Convert pyserial's exception to an error of the catalogue."""
    code = error.errno
    if code in (errno.EACCES, errno.EPERM):
        return PortDenied(f"no permission to open {device}", found=str(error))
    if code in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or any(
            # pyserial has no error number for a port of Windows that another program has open.
            words in str(error) for words in ("lock", "PermissionError(13")):
        others = [f"pid {pid} ({name})" for pid, name in holders(device) if pid != os.getpid()]
        return PortBusy(f"{device} is in use", found=", ".join(others) or str(error))
    here = ", ".join(p.device for p in list_ports.comports()) or "no serial ports at all"
    reason = os.strerror(code) if code else str(error)
    return PortMissing(f"cannot open {device}", found=f"{reason}; present: {here}")


def find_port(pattern: str) -> str:
    """Return the device whose USB id or description matches. Raises PortMissing, UsageError."""
    try:
        found = list(list_ports.grep(pattern))
    except re.error as error:
        raise UsageError(f"hwgrep://{pattern} is no pattern of a port's name", found=str(error),
                         expected="a USB id such as 1A86:7523, or a regular expression",
                         remedy="put a backslash before ( [ * + ? that are meant as such"
                         ) from error
    if found:
        return str(found[0].device)
    here = ", ".join(f"{p.device} ({p.hwid})" for p in list_ports.comports())
    raise PortMissing(f"no serial port matches {pattern!r}", found=here or "no serial ports at all",
                      expected="a CH340 is 1A86:7523, an FT232 is 0403:6001")


def candidates(device: str, pattern: str | None) -> Callable[[], list[str]]:
    """Return a function that lists the ports where an unplugged board may be found again.

    First its former name, which udev may keep, then ports of the same USB bridge, or of the URL's
    ``pattern``. No other ports: opening one resets its board.
    """
    here = {port.device: port for port in list_ports.comports()}
    was = here.get(os.path.realpath(device))

    def present() -> list[str]:
        names = [device] if os.path.exists(device) else []
        if pattern is not None:
            names += [port.device for port in list_ports.grep(pattern)]
        elif was is not None and was.vid is not None:
            names += [port.device for port in list_ports.comports()
                      if (port.vid, port.pid) == (was.vid, was.pid)]
        return list({os.path.realpath(name): name for name in reversed(names)}.values())[::-1]

    return present


def open_serial(url: Url) -> Backend:
    """Open the backend of ``serial://`` and ``hwgrep://``."""
    url.known("i2c", "baud")
    device = url.target if url.scheme == "serial" else find_port(url.target)
    if not device:
        raise PortMissing(f"{url.text} names no port", expected="serial:///dev/ttyUSB0?i2c=1")
    rate = url.options.get("baud", str(RATES[0]))
    if not rate.isascii() or not rate.isdigit() or int(rate) == 0:
        raise UsageError(f"baud={rate!r} is not a line rate", found=url.text,
                         expected=" or ".join(map(str, RATES)))
    url = resolve_bus(url)
    if "i2c" in url.options:
        check_bus(url.options["i2c"])
    link = SerialLink(device, int(rate))
    try:
        bus = open_bus(url.options["i2c"]) if "i2c" in url.options else None
    except BaseException:
        link.close()
        raise
    joined = "&" if url.options else "?"
    notices = () if bus else (
        f"no I2C bus in the URL: commands are not sent (try {url.text}{joined}i2c=auto)",)
    closers = (bus.close,) if isinstance(bus, SocketBus | SmbusBus) else ()
    return Backend(url=url, link=link, clock=RealClock(), bus=bus, virtual=False, notices=notices,
                   closers=closers, candidates=candidates(
                       device, url.target if url.scheme == "hwgrep" else None))
