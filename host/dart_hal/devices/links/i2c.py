"""The I2C bus of a URL: ``i2c=1`` is /dev/i2c-1, ``i2c=unix:/path`` a socket.

The socket carries the bus of a simulated car to other programs
(``dart-hal sim --bus /path``). One request per transfer:

    address u8 | write length u16 | read length u16 | bytes to write
    errno u8 | bytes read        (errno 0 = done; the answer)
"""

from __future__ import annotations

import os
import struct
import sys
from typing import TYPE_CHECKING

from dart_hal.core.errors import BusError, UsageError
from dart_hal.core.ports import Bus
from dart_hal.core.ports.bus import explain
from dart_hal.core.process.forks import private
from dart_hal.devices.links.busio import TransferBus
from dart_hal.devices.links.smbus import SmbusBus

if TYPE_CHECKING:
    import socket

REQUEST = struct.Struct("<BHH")
# s: a transfer takes 1 ms; without an answer the server is gone.
TIMEOUT = 1.0


def check_bus(spec: str) -> None:
    """Check the name of a bus before anything is opened. Raises UsageError."""
    if not spec.startswith("unix:") and not (spec.isascii() and spec.isdigit()):
        raise UsageError(f"i2c={spec} names no bus",
                         expected="i2c=auto, i2c=1 or i2c=unix:/path/of/socket")


def open_bus(spec: str) -> Bus:
    """Open the bus of a URL. Raises BusError, UsageError."""
    check_bus(spec)
    if spec.startswith("unix:"):
        return SocketBus(spec[len("unix:"):])
    return SmbusBus(int(spec))


def receive(connection: socket.socket, n: int) -> bytes:
    """Receive exactly ``n`` bytes of a stream socket. Raises ConnectionError at its end."""
    data = b""
    while len(data) < n:
        part = connection.recv(n - len(data))
        if not part:
            raise ConnectionError("the other end closed the socket")
        data += part
    return data


class SocketBus(TransferBus):
    """Client of a simulated car's I2C bus, with the interface of ``busio.I2C``."""

    def __init__(self, path: str) -> None:
        self.where = f"unix:{path}"
        self._path = path
        self._socket: socket.socket | None = self._connect()

    def _connect(self) -> socket.socket:
        import socket

        if not hasattr(socket, "AF_UNIX"):
            raise BusError(f"i2c=unix:{self._path} needs unix sockets", found=sys.platform,
                           remedy="use Linux, macOS or WSL, or sim:// in the same program")
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.settimeout(TIMEOUT)
        try:
            connection.connect(self._path)
        except OSError as error:
            connection.close()
            raise BusError(f"no simulated I2C bus at {self._path}", found=str(error),
                           remedy=f"dart-hal sim --pty --bus {self._path}") from error
        return private(connection)

    def close(self) -> None:
        """Close the socket; a later transfer connects again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """Send one request and return its answer. Raises BusError."""
        if self._socket is None:
            self._socket = self._connect()
        try:
            self._socket.sendall(REQUEST.pack(address, len(data), n) + data)
            code = receive(self._socket, 1)[0]
            answer = receive(self._socket, n) if code == 0 else b""
        except BaseException as error:
            self.close()  # a late answer must not be read as that of the next transfer
            if isinstance(error, OSError):
                raise explain(error, address, self.where) from error
            raise
        if code:
            raise explain(OSError(code, os.strerror(code)), address, self.where)
        return answer
