"""A lidar on a serial port: a thread that reads and stamps, and opens the port again.

DTR of the adapter lets the motor run. ``START`` is sent as the port is opened and once more
while nothing comes; an X4 Pro streams by itself and does not mind.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress

from dart_hal.core.errors import DartHalError, LinkLost, NoScan
from dart_hal.core.ports import Chunk
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.packets import START, STOP
from dart_hal.devices.lidar.scan import Stream
from dart_hal.devices.links.serial_port import SerialLink, candidates

READ = 0.05
"""s that a read waits at most: so soon does the thread end."""
AGAIN = 0.5
"""s between two tries to open a port that is gone, and between two ``START``."""
PATIENCE = 3.0
"""s without a packet from which on it is said: the motor takes 1 to 2 s to its pace."""
KEPT = 1000
"""Chunks that wait for the car: 8 s of packets."""
NOISE = 400
"""Bytes without a packet that are no beginning of a stream any more: four packets."""


class SerialLidar:
    """``ScanSource`` of an X4; the port is opened at once. Raises PortMissing, PortBusy,
    PortDenied, UsageError. ``stream``: counters of what came."""

    def __init__(self, device: str, baud: int, name: str, pattern: str | None = None) -> None:
        self.name, self.baud = name, baud
        self.stream = Stream()
        self._link: SerialLink | None = SerialLink(device, baud, dtr=True)
        self._present = candidates(device, pattern)
        self._lost: DartHalError | None = None
        self._chunks: deque[Chunk] = deque(maxlen=KEPT)
        self._came = 0
        self._good = self._polled = self._asked = elapsed()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, name="lidar", daemon=True)
        self._send(START)
        self._thread.start()

    @property
    def trouble(self) -> DartHalError | None:
        """The port is gone, it is silent, or what comes are no packets."""
        if self._lost is not None:
            return self._lost
        if self._polled - self._good < PATIENCE:
            return None
        if self._came < NOISE:
            return NoScan(f"{self.name}: the lidar is silent", found=f"{self._came} bytes")
        decoder = self.stream.decoder
        return NoScan(
            f"{self.name}: bytes come at {self.baud} baud that are no packets",
            found=f"{self._came} bytes without a packet, {decoder.broken} of them like a head",
            likely="another line rate, or another device on this port",
            remedy="?baud=128000 for an X4, 115200 and 230400 for other models")

    def poll(self, now: float) -> list[Scan]:
        """As ``ScanSource``; the times of arrival are those of the reading thread."""
        scans: list[Scan] = []
        self._polled = received = elapsed()
        while self._chunks:
            chunk = self._chunks.popleft()
            before = self.stream.decoder.packets
            scans += self.stream.feed(chunk.data, now - (received - chunk.t))
            self._came += len(chunk.data)
            if self.stream.decoder.packets > before:
                self._good, self._came = received, 0
        return scans

    def close(self) -> None:
        """Stop the unit and let go of the port."""
        self._stop.set()
        self._thread.join()
        self._send(STOP)
        if self._link is not None:
            self._link.close()
        self._link = None

    def _read(self) -> None:
        while not self._stop.is_set():
            link = self._link
            if link is None:
                self._stop.wait(AGAIN)
                self._reopen()
                continue
            try:
                chunk = link.read(READ)
            except LinkLost as why:
                self._lose(link, why)
                continue
            if chunk is not None:
                self._chunks.append(chunk)
            elif elapsed() - self._asked > AGAIN:
                self._send(START)

    def _lose(self, link: SerialLink, why: LinkLost) -> None:
        self._lost = LinkLost(f"{self.name}: the lidar's port vanished", found=why.found,
                              likely="cable pulled out, or its adapter without power",
                              remedy="plug it in again: it goes on by itself")
        self._link = None
        link.close()

    def _reopen(self) -> None:
        """The first port where it may be again."""
        for device in self._present():
            with suppress(DartHalError):
                self._link = SerialLink(device, self.baud, dtr=True)
                self._lost, self._good = None, elapsed()
                self._send(START)
                return

    def _send(self, command: bytes) -> None:
        self._asked = elapsed()
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(command)
