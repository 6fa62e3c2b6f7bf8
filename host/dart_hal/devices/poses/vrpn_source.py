"""Poses from a VRPN server (Vicon Tracker, Motive, vrpn_server) over TCP; never waits."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses import vrpn
from dart_hal.devices.poses.natnet_source import address
from dart_hal.devices.poses.reading import Convention
from dart_hal.devices.poses.rigid import reading

PORT = 3883
AGAIN = 1.0
"""s between two attempts to connect."""
SILENT = 5.0
"""s without a byte after which a connection is made anew: its other end may have restarted."""
AT_ONCE = 1 << 18
"""Bytes of one poll: 10 ms of 200 bodies of 1 kHz; a flood must not hold up the car."""


class VrpnSource:
    """Poses of one tracker. ``why``, ``refused``, ``others`` as those of NatNetSource;
    ``connections``: how often it was connected."""

    on_board = False

    def __init__(self, host: str, port: int, sensor: int, convention: Convention, name: str,
                 clock: Callable[[], float] = elapsed) -> None:
        self.name = name
        self.refused = self.connections = 0
        self.others: set[str] = set()
        self.why = "not connected yet"
        self._address, self._sensor = (address(host, name), port), sensor
        self._convention, self._clock = convention, clock
        self._body = convention.body
        self._socket: socket.socket | None = None
        self._parser = vrpn.Parser()
        self._to_send = b""
        self._tried = self._heard = float("-inf")

    def poll(self, now: float) -> list[ExternalPose]:
        """Poses that have come, as ``PoseSource``."""
        t = self._clock()
        if self._socket is not None and t - self._heard > SILENT:
            self._drop(f"connected, but silent for {SILENT:g} s")
        if self._socket is None and t - self._tried >= AGAIN:
            self._connect(t)
        try:
            found = self._read(t)
        except (OSError, ValueError) as why:
            self.refused += isinstance(why, ValueError)
            self._drop(str(why))
            return []
        return [pose for one in found if (pose := self._pose(one, now)) is not None]

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _connect(self, t: float) -> None:
        self._tried = self._heard = t
        self._parser, self._to_send = vrpn.Parser(), vrpn.COOKIE
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        failed = self._socket.connect_ex(self._address)
        if failed not in (0, errno.EINPROGRESS):
            self._drop(errno.errorcode.get(failed, str(failed)))

    def _drop(self, why: str) -> None:
        self.why = why
        self.close()

    def _read(self, t: float) -> list[vrpn.Tracked]:
        """What has come. Raises OSError, ValueError: the connection is lost."""
        if self._socket is None:
            return []
        out: list[vrpn.Tracked] = []
        try:
            if self._to_send:  # before the connection stands: BlockingIOError
                sent = self._socket.send(self._to_send)
                self._to_send = self._to_send[sent:]
                self.connections += not self._to_send
                self.why = f"connected; no pose of {self._body or 'any body'} yet"
            data = self._socket.recv(AT_ONCE)
        except BlockingIOError:
            return out
        if not data:
            raise ConnectionError("the server ended the connection")
        self._heard = t
        return self._parser.feed(data)

    def _pose(self, found: vrpn.Tracked, now: float) -> ExternalPose | None:
        name = found.body.name
        self._body = self._body or name
        if name != self._body or found.sensor != self._sensor:
            self.others.add(name if found.sensor == 0 else f"{name}, sensor {found.sensor}")
            return None
        try:
            seen = reading(found.body, found.t, "vrpn", self._convention.y_up)
            pose = self._convention.read(seen).at(now)
        except ValueError as why:
            self.refused, self.why = self.refused + 1, str(why)
            return None
        self.why = ""
        return pose
