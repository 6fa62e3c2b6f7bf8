"""A simulated car for other programs: its Nano on a pty, its I2C bus on a socket.

The thread of the pty runs the world in real time; a thread per bus client runs transfers. One lock
serialises them, so a transfer acts at one instant of the world.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import threading
from pathlib import Path

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.i2c import REQUEST, receive
from dart_lab.sim.link import SimLink
from dart_lab.sim.world import World

NO_DEVICE = 121


class PacedWorld:
    """A simulated car with the interface that ``links.pty`` runs in real time.

    Damage of the line is that of the URL; its delays are those of the pty.
    """

    def __init__(self, backend: Backend) -> None:
        if not isinstance(backend.link, SimLink):
            raise UsageError(f"{backend.url.text} cannot be served", expected="sim://, without "
                             "pace: a port is always served in real time")
        self._world: World = backend.link._world
        self.lock = threading.Lock()

    @property
    def now(self) -> float:
        return self._world.t

    def run(self, until: float) -> bool:
        with self.lock:
            return self._world.advance(until)

    def read(self) -> list[tuple[bytes, float]]:
        with self.lock:
            up = self._world.lines[0]
            carried = [(up.carry(data, t)[0], t) for data, t in self._world.nano.read()]
            return [(data, t) for data, t in carried if data]

    def write(self, data: bytes) -> None:
        with self.lock:
            self._world.nano.write(self._world.lines[1].carry(data, self._world.t)[0])

    def set_baud(self, host_baud: float) -> None:
        self._world.nano.set_baud(host_baud)

    def reset(self, cause: str = "external") -> None:
        with self.lock:
            self._world.nano.reset(cause)


def _remove_stale_socket(path: Path) -> None:
    """Remove the socket of a server that was killed.

    Raises UsageError for a file, and for a socket that is being served.
    """
    if not path.exists():
        return
    if not stat.S_ISSOCK(path.stat().st_mode):
        raise UsageError(f"{path} is a file, not a socket of this program",
                         expected="a path that is free",
                         remedy="name another path with --bus")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(os.fspath(path))
        except OSError:
            # No server listens: the server has been killed.
            path.unlink()
            return
    raise UsageError(f"{path} is served by another car", expected="a path that is free",
                     remedy="name another path with --bus")


class BusServer:
    """Serves a simulated car's I2C bus on a unix socket; a context manager."""

    def __init__(self, backend: Backend, paced: PacedWorld, path: Path) -> None:
        self.path = path
        self._bus = backend.bus
        self._paced = paced
        _remove_stale_socket(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.bind(os.fspath(path))
        self._socket.listen()
        threading.Thread(target=self._accept, name="i2c socket", daemon=True).start()

    def __enter__(self) -> BusServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()
        with contextlib.suppress(FileNotFoundError):
            self.path.unlink()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            while True:
                address, wrote, n = REQUEST.unpack(receive(client, REQUEST.size))
                client.sendall(self._transfer(address, receive(client, wrote), n))

    def _transfer(self, address: int, data: bytes, n: int) -> bytes:
        assert self._bus is not None
        answer = bytearray(n)
        try:
            with self._paced.lock:
                if data and n:
                    self._bus.writeto_then_readfrom(address, data, answer)
                elif data:
                    self._bus.writeto(address, data)
                elif n:
                    self._bus.readfrom_into(address, answer)
        except OSError as error:
            return bytes([error.errno or NO_DEVICE])
        return b"\0" + bytes(answer)
