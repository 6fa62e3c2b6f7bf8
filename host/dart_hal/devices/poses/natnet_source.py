"""Poses from OptiTrack Motive: a client of its NatNet server, unicast or multicast; never waits."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable

from dart_hal.core.errors import DartHalError, PortMissing
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import ExternalPose
from dart_hal.devices.poses import natnet
from dart_hal.devices.poses.reading import Convention
from dart_hal.devices.poses.rigid import project_to_floor
from dart_hal.devices.poses.udp import Port

COMMAND_PORT = 1510
# s between two requests, and between two keep-alive messages, without which Motive ends a unicast.
REQUEST_INTERVAL = 1.0
# s without a frame after which the server is requested to identify itself again.
MAX_FRAME_GAP = 2.0


class NatNetSource:
    """Poses of one rigid body.

    ``why``: why no poses arrive, "" while they do; ``refused``: messages that could not be read;
    ``missed``: lost frames; ``untracked``: frames in which the body was not tracked; ``others``:
    names of other bodies.
    """

    on_board = False
    map_std = 0.0

    def __init__(self, host: str, port: int, convention: Convention, name: str,
                 clock: Callable[[], float] = elapsed) -> None:
        self.name = name
        self.refused = self.missed = self.untracked = 0
        self.others: set[str] = set()
        self.why = f"{host}:{port} has not answered; does Motive stream by NatNet?"
        self._address = (resolve_host(host, name), port)
        self._convention = convention
        self._clock = clock
        self._body = convention.body
        self._commands = Port("", 0, name)
        self._data: Port | None = None
        self._server: natnet.Server | None = None
        self._names: dict[str, str] = {}
        self._number: int | None = None
        self._requested_at = self._heard = float("-inf")

    def poll(self, now: float) -> list[ExternalPose]:
        """Return the poses of the frames that have arrived, as ``PoseSource``."""
        self._send_requests()
        out: list[ExternalPose] = []
        for port in (self._commands, self._data):
            for data, age in port.read() if port is not None else ():
                try:
                    out += self._message(data, max(now - age, 0.0))
                except ValueError as why:
                    self.refused += 1
                    self.why = str(why)
        return sorted(out, key=lambda pose: pose.arrival)

    def close(self) -> None:
        self._commands.close()
        if self._data is not None:
            self._data.close()

    def _send_requests(self) -> None:
        """Request the server's identification, then its bodies; send keep-alive in unicast."""
        t = self._clock()
        if t - self._requested_at < REQUEST_INTERVAL:
            return
        self._requested_at = t
        if self._server is None or t - self._heard > MAX_FRAME_GAP:
            if self._server is not None and not self.why:
                self.why = f"no frame for {MAX_FRAME_GAP:g} s"
            self._send(natnet.request(natnet.CONNECT, "Ping"))
        if self._server is not None and not self._knows_body():
            self._send(natnet.request(natnet.REQUEST_MODELS))
        if self._server is not None and not self._server.group:
            self._send(natnet.request(natnet.KEEP_ALIVE))

    def _knows_body(self) -> bool:
        """Return whether the name of the body is known, or of any body if none was selected."""
        return self._body in (self._names.values() if self._body else self._names)

    def _send(self, data: bytes) -> None:
        try:
            self._commands.socket.sendto(data, self._address)
        except OSError as why:  # no route, a full buffer: repeated in a second
            self.why = f"a request cannot be sent: {why}"

    def _message(self, data: bytes, arrival: float) -> list[ExternalPose]:
        kind, payload = natnet.message(data)
        if kind == natnet.SERVER_INFO:
            self._set_server(natnet.server(payload))
        elif kind == natnet.MODELS_MESSAGE and self._server is not None:
            self._names = natnet.models(payload, self._server.version)
            if self._body and not self._knows_body():
                self.why = f"no body {self._body!r}; bodies: {sorted(self._names.values())}"
        elif kind == natnet.FRAME_MESSAGE and self._server is not None:
            self._heard = self._clock()
            return self._frame(natnet.frame(payload, self._server.version), arrival)
        return []

    def _set_server(self, found: natnet.Server) -> None:
        """Store the server that has answered; join its multicast group if it has one."""
        if found == self._server:
            return
        self._server = found
        self._number = None
        self._requested_at = float("-inf")
        self._heard = self._clock()
        self.why = f"{found.application} answered, and has sent no body yet"
        if self._data is not None:
            self._data.close()
            self._data = None
        if found.group:
            self._join(found.group, found.data_port)

    def _join(self, group: str, port: int) -> None:
        try:
            self._data = Port("", port, self.name, shared=True)
            self._data.socket.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                struct.pack("4s4s", socket.inet_aton(group), self._local()))
        except (OSError, DartHalError) as why:
            self.why = f"cannot join {group}: {why}"

    def _local(self) -> bytes:
        """Return the local address of the route to the server; connecting UDP sends nothing."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect(self._address)
            return socket.inet_aton(probe.getsockname()[0])

    def _frame(self, found: natnet.NatNetFrame, arrival: float) -> list[ExternalPose]:
        if self._number is not None and found.number > self._number + 1:
            self.missed += found.number - self._number - 1
        self._number = found.number
        self.untracked += sum(self._names.get(n, n) == self._body for n in found.lost)
        assert self._server is not None
        t = found.exposed / self._server.ticks if found.exposed and self._server.ticks else found.t
        for body in found.bodies:
            name = self._names.get(body.name, body.name)
            self._body = self._body or name
            if name != self._body:
                self.others.add(name)
                continue
            reading = project_to_floor(body._replace(name=name), t, "natnet",
                                       self._convention.y_up)
            pose = self._convention.read(reading).to_external(arrival)
            self.why = ""
            return [pose]
        return []


def resolve_host(host: str, name: str) -> str:
    """Return the IPv4 address of a host. Raises PortMissing."""
    try:
        return socket.gethostbyname(host)
    except OSError as why:
        raise PortMissing(f"{name}: there is no host {host}", found=str(why),
                          expected="the name or address of the computer that streams",
                          remedy="its address in numbers: natnet://192.168.1.10") from why
