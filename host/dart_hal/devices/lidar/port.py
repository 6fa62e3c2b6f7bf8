"""A lidar on a serial port: a thread reads and stamps its bytes, and opens a lost port again.

DTR of the adapter switches the motor on and off. The commands of the model are sent when the port
is opened and again while no byte arrives; an X4 Pro and an LD19 stream by themselves and ignore
them.

Where the model is not stated, each is tried at its line rates, until one answers or sends packets.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress

from dart_hal.core.errors import DartHalError, LinkLost, NoScan
from dart_hal.core.ports import Chunk
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.models import UNKNOWN_MODELS, LidarModel, recognise
from dart_hal.devices.lidar.packets import Answer
from dart_hal.devices.lidar.scan import LidarStream
from dart_hal.devices.links.serial_port import SerialLink, candidates

# s that a read waits; the thread ends within this time.
READ_TIMEOUT = 0.05
# s between two attempts to open a lost port, and between two starts of a silent unit.
PORT_RETRY_INTERVAL = 0.5
# s between two commands: a unit answers one at a time.
COMMAND_INTERVAL = 0.02
# s for which an unknown lidar is tried as one model: the motor needs 1 to 2 s.
PROBE_TIME = 3.0
# s without a packet before it is reported: the motor needs 1 to 2 s to reach its speed.
MAX_LIDAR_SILENCE = 3.0
# Chunks that wait for the car: 8 s of packets.
MAX_WAITING_CHUNKS = 1000
# Bytes without a packet, four packets long: the start of a stream has fewer.
MAX_BYTES_WITHOUT_PACKET = 400
# Newest bytes that are searched for packets of another lidar.
MAX_SEARCHED_BYTES = 400


class SerialLidar:
    """``ScanSource`` of a lidar; the port is opened at once. Raises PortMissing, PortBusy,
    PortDenied, UsageError.

    model: None = it is recognised; baud: None = those of the model. ``stream``: of the present
    model, with counters of the received packets.
    """

    def __init__(self, device: str, baud: int | None, name: str, pattern: str | None = None,
                 model: LidarModel | None = None) -> None:
        self.name = name
        models = UNKNOWN_MODELS if model is None else (model,)
        self._trials = [(m, rate) for m in models
                        for rate in ((baud,) if baud is not None else m.bauds)]
        self._trial = 0
        self._recognised = len(self._trials) == 1
        self._begin_trial()
        self._link: SerialLink | None = SerialLink(device, self.baud, dtr=self.model.dtr)
        self._present = candidates(device, pattern)
        self._lost: DartHalError | None = None
        self._chunks: deque[tuple[LidarStream, Chunk]] = deque(maxlen=MAX_WAITING_CHUNKS)
        self._bytes = 0
        self._newest = b""
        self._answers: dict[int, Answer] = {}
        self._good = self._polled = self._sent_at = elapsed()
        self._commands: deque[bytes] = deque(self.model.start)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, name="lidar", daemon=True)
        self._send_next()
        self._thread.start()

    def _begin_trial(self) -> None:
        """Make the stream of the present model and line rate."""
        self.model, self.baud = self._trials[self._trial]
        self.stream = LidarStream(self.model, self.baud)
        # The reading thread has a decoder of its own: programs may poll seldom.
        self._probe = self.model.make_decoder()
        self._tried_since = elapsed()

    @property
    def trouble(self) -> DartHalError | None:
        """Present error: the port is gone, it is silent, or its bytes are no packets."""
        if self._lost is not None:
            return self._lost
        if self._polled - self._good < MAX_LIDAR_SILENCE:
            return None
        if self._bytes < MAX_BYTES_WITHOUT_PACKET:
            answers = [f"{self._bytes} bytes", *(a.text() for a in self._answers.values())]
            return NoScan(f"{self.name}: the lidar is silent", found="; ".join(answers))
        decoder = self.stream.decoder
        other = recognise(self._newest)
        found = f"{self._bytes} bytes without a packet, {decoder.broken} starts of a packet"
        if other is not None and other is not self.model:
            found = f"packets of an {other.title}"
        return NoScan(
            f"{self.name}: bytes come at {self.baud} baud that are no packets", found=found,
            expected=", ".join(f"{m.title} at {rate} baud" for m, rate in self._trials),
            likely="another line rate, or another device on this port",
            remedy="leave out model= and baud= of its URL, so that each model is tried")
    def poll(self, now: float) -> list[Scan]:
        """As ``ScanSource``; the times of arrival are those of the reading thread."""
        scans: list[Scan] = []
        self._polled = received = elapsed()
        while self._chunks:
            stream, chunk = self._chunks.popleft()
            packets = stream.decoder.packets
            scans += stream.feed(chunk.data, now - (received - chunk.t))
            self._bytes += len(chunk.data)
            self._newest = (self._newest + chunk.data)[-MAX_SEARCHED_BYTES:]
            self._answers = stream.decoder.answers
            if stream.decoder.packets > packets:
                self._good = received
                self._bytes = 0
                self._newest = b""
        return scans

    def close(self) -> None:
        """Stop the unit and release the port."""
        self._stop.set()
        self._thread.join()
        for command in self.model.stop:
            self._send(command)
        if self._link is not None:
            self._link.set_dtr(not self.model.dtr)
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
                self._chunks.append((self.stream, chunk))
            self._continue_start(chunk is None)
            if not self._recognised:
                self._try_models(chunk)

    def _continue_start(self, silent: bool) -> None:
        """Send the next command of the start; begin it again while the unit is silent."""
        waited = elapsed() - self._sent_at
        if silent and not self._commands and waited > PORT_RETRY_INTERVAL:
            self._commands.extend(self.model.start)
        if self._commands and waited > COMMAND_INTERVAL:
            self._send_next()

    def _try_models(self, chunk: Chunk | None) -> None:
        """Keep the present model if it has sent packets or answers; try the next one in time."""
        if chunk is not None:
            self._probe.feed(chunk.data)
        if self._probe.packets or self._probe.answers:
            self._recognised = True
        elif elapsed() - self._tried_since > PROBE_TIME:
            self._trial = (self._trial + 1) % len(self._trials)
            self._begin_trial()
            link = self._link
            self._link = None
            if link is not None:
                link.close()

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
                self._link = SerialLink(device, self.baud, dtr=self.model.dtr)
                if self._lost is not None:
                    self._lost = None
                    self._good = elapsed()
                self._commands = deque(self.model.start)
                self._send_next()
                return

    def _send_next(self) -> None:
        """Send the next command of the start, if there is one."""
        if self._commands:
            self._send(self._commands.popleft())

    def _send(self, command: bytes) -> None:
        self._sent_at = elapsed()
        if self._link is not None:
            with suppress(LinkLost):
                self._link.write(command)
