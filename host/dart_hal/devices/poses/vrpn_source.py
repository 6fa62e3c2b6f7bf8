"""Poses from a VRPN server (Vicon Tracker, Motive, vrpn_server) over TCP; never waits."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses import vrpn
from dart_hal.devices.poses.natnet_source import resolve_host
from dart_hal.devices.poses.reading import Convention
from dart_hal.devices.poses.rigid import project_to_floor

VRPN_PORT = 3883
# s between two attempts to connect.
CONNECT_INTERVAL = 1.0
# s without a byte before the client connects again: the server may have restarted.
MAX_VRPN_SILENCE = 5.0
# Bytes per poll: 10 ms of 200 bodies at 1 kHz. More of them must not delay the car.
MAX_POLL_BYTES = 1 << 18


class VrpnSource:
    """Poses of one tracker. ``why``, ``refused``, ``others`` as in NatNetSource;
    ``connections``: number of connections so far."""

    on_board = False
    map_std = 0.0

    def __init__(self, host: str, port: int, sensor: int, convention: Convention, name: str,
                 clock: Callable[[], float] = elapsed) -> None:
        self.name = name
        self.refused = self.connections = 0
        self.others: set[str] = set()
        self.why = "not connected yet"
        self._address = (resolve_host(host, name), port)
        self._sensor = sensor
        self._convention = convention
        self._clock = clock
        self._body = convention.body
        self._socket: socket.socket | None = None
        self._parser = vrpn.Parser()
        self._to_send = b""
        self._tried = self._heard = float("-inf")

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the poses that have arrived, as ``PoseSource``."""
        t = self._clock()
        if self._socket is not None and t - self._heard > MAX_VRPN_SILENCE:
            self._drop(f"connected, but silent for {MAX_VRPN_SILENCE:g} s")
        if self._socket is None and t - self._tried >= CONNECT_INTERVAL:
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
        """Start to connect without waiting."""
        self._tried = self._heard = t
        self._parser = vrpn.Parser()
        self._to_send = vrpn.COOKIE
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        failed = self._socket.connect_ex(self._address)
        if failed not in (0, errno.EINPROGRESS):
            self._drop(errno.errorcode.get(failed, str(failed)))

    def _drop(self, why: str) -> None:
        self.why = why
        self.close()

    def _read(self, t: float) -> list[vrpn.TrackedPose]:
        """Read the poses that have arrived. Raises OSError, ValueError: the connection is lost."""
        if self._socket is None:
            return []
        out: list[vrpn.TrackedPose] = []
        try:
            if self._to_send:  # while it is connecting: BlockingIOError
                sent = self._socket.send(self._to_send)
                self._to_send = self._to_send[sent:]
                self.connections += not self._to_send
                self.why = f"connected; no pose of {self._body or 'any body'} yet"
            data = self._socket.recv(MAX_POLL_BYTES)
        except BlockingIOError:
            return out
        if not data:
            raise ConnectionError("the server ended the connection")
        self._heard = t
        return self._parser.feed(data)

    def _pose(self, found: vrpn.TrackedPose, now: float) -> ExternalPose | None:
        """Convert a tracked pose; None for another body and for an invalid pose."""
        name = found.body.name
        self._body = self._body or name
        if name != self._body or found.sensor != self._sensor:
            self.others.add(name if found.sensor == 0 else f"{name}, sensor {found.sensor}")
            return None
        try:
            reading = project_to_floor(found.body, found.t, "vrpn", self._convention.y_up)
            pose = self._convention.read(reading).to_external(now)
        except ValueError as why:
            self.refused += 1
            self.why = str(why)
            return None
        self.why = ""
        return pose
