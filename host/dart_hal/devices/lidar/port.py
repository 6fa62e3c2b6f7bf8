"""A lidar on a serial port: a thread reads and stamps its bytes, and opens a lost port again.

DTR of the adapter switches the motor on. ``START_COMMAND`` is sent when the port is opened and
again while no byte arrives; an X4 Pro streams by itself and ignores it.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress

from dart_hal.core.errors import DartHalError, LinkLost, NoScan
from dart_hal.core.ports import Chunk
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.packets import START_COMMAND, STOP_COMMAND
from dart_hal.devices.lidar.scan import LidarStream
from dart_hal.devices.links.serial_port import SerialLink, candidates

# s that a read waits; the thread ends within this time.
READ_TIMEOUT = 0.05
# s between two attempts to open a lost port, and between two ``START_COMMAND``.
PORT_RETRY_INTERVAL = 0.5
# s without a packet before it is reported: the motor needs 1 to 2 s to reach its speed.
MAX_LIDAR_SILENCE = 3.0
# Chunks that wait for the car: 8 s of packets.
MAX_WAITING_CHUNKS = 1000
# Bytes without a packet, four packets long: the start of a stream has fewer.
MAX_BYTES_WITHOUT_PACKET = 400


class SerialLidar:
    """``ScanSource`` of an X4; the port is opened at once. Raises PortMissing, PortBusy,
    PortDenied, UsageError. ``stream``: with counters of the received packets."""

    def __init__(self, device: str, baud: int, name: str, pattern: str | None = None) -> None:
        self.name = name
        self.baud = baud
        self.stream = LidarStream()
        self._link: SerialLink | None = SerialLink(device, baud, dtr=True)
        self._present = candidates(device, pattern)
        self._lost: DartHalError | None = None
        self._chunks: deque[Chunk] = deque(maxlen=MAX_WAITING_CHUNKS)
        self._bytes = 0
        self._good = self._polled = self._sent_at = elapsed()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, name="lidar", daemon=True)
        self._send(START_COMMAND)
        self._thread.start()

    @property
    def trouble(self) -> DartHalError | None:
        """Present error: the port is gone, it is silent, or its bytes are no packets."""
        if self._lost is not None:
            return self._lost
        if self._polled - self._good < MAX_LIDAR_SILENCE:
            return None
        if self._bytes < MAX_BYTES_WITHOUT_PACKET:
            return NoScan(f"{self.name}: the lidar is silent", found=f"{self._bytes} bytes")
        decoder = self.stream.decoder
        return NoScan(
            f"{self.name}: bytes come at {self.baud} baud that are no packets",
            found=f"{self._bytes} bytes without a packet, {decoder.broken} starts of a packet",
            likely="another line rate, or another device on this port",
            remedy="?baud=128000 for an X4, 115200 and 230400 for other models")

    def poll(self, now: float) -> list[Scan]:
        """As ``ScanSource``; the times of arrival are those of the reading thread."""
        scans: list[Scan] = []
        self._polled = received = elapsed()
        while self._chunks:
            chunk = self._chunks.popleft()
            packets = self.stream.decoder.packets
            scans += self.stream.feed(chunk.data, now - (received - chunk.t))
            self._bytes += len(chunk.data)
            if self.stream.decoder.packets > packets:
                self._good = received
                self._bytes = 0
        return scans

    def close(self) -> None:
        """Stop the unit and release the port."""
        self._stop.set()
        self._thread.join()
        self._send(STOP_COMMAND)
        if self._link is not None:
            self._link.close()
        self._link = None

    def _read(self) -> None:
        """Read and stamp bytes until ``close``; body of the thread."""
        while not self._stop.is_set():
            link = self._link
            if link is None:
                self._stop.wait(PORT_RETRY_INTERVAL)
                self._reopen()
                continue
            try:
                chunk = link.read(READ_TIMEOUT)
            except LinkLost as why:
                self._lose(link, why)
                continue
            if chunk is not None:
                self._chunks.append(chunk)
            elif elapsed() - self._sent_at > PORT_RETRY_INTERVAL:
                self._send(START_COMMAND)

    def _lose(self, link: SerialLink, why: LinkLost) -> None:
        """Note that the port is gone, and close it."""
        self._lost = LinkLost(f"{self.name}: the lidar's port vanished", found=why.found,
                              likely="cable pulled out, or its adapter without power",
                              remedy="plug it in again: it continues by itself")
        self._link = None
        link.close()

    def _reopen(self) -> None:
        """Open the first port that may be the lidar's."""
        for device in self._present():
            with suppress(DartHalError):
                self._link = SerialLink(device, self.baud, dtr=True)
                self._lost = None
                self._good = elapsed()
                self._send(START_COMMAND)
                return

    def _send(self, command: bytes) -> None:
        self._sent_at = elapsed()
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(command)
