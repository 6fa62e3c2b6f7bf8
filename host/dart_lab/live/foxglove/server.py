"""Server of an open car's messages, in a separate thread that does not delay the drive.

1. The drive appends each message to a queue and goes on.
2. Every SEND_PERIOD_S the thread distributes the queue to the clients that subscribed.
3. Each client has its own queue. It is dropped when it grows too long, so a client that stalls
   does not delay the others.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.recording.run_file import RunFile
from dart_hal.recording.schemas import definition
from dart_lab.live.foxglove import LAYOUT, protocol
from dart_lab.live.foxglove.protocol import MalformedRequest

# Port that Foxglove opens by default.
DEFAULT_PORT = 8765
# Pages that may connect: Foxglove's and a local Lichtblick. Pages of other origins in the same
# browser are refused. Programs send no Origin and are accepted.
ALLOWED_ORIGINS = ("https://app.foxglove.dev", "http://localhost:8080")
# Time between two batches to the clients: the largest delay added here.
SEND_PERIOD_S = 0.02
# Largest queue of a client, about 40 s of all channels. A longer queue is dropped.
MAX_BACKLOG_BYTES = 8 << 20
# Messages kept between two batches: about 4 s of all channels.
MAX_PENDING_MESSAGES = 4000
# Largest message of a client; a longer one closes its connection.
MAX_REQUEST_BYTES = 1 << 16
READ_ONLY = "this server is read-only: drive by the live page, a gamepad or a program"


class MessageSource(Protocol):
    """Source of the messages of a car (``car.Recorder``)."""

    def messages(self) -> RunFile: ...


class LiveCar(Protocol):
    """The part of a ``Car`` that is served."""

    @property
    def files(self) -> CarFiles: ...
    @property
    def recorder(self) -> MessageSource: ...


@contextmanager
def serve(car: LiveCar, *, port: int = DEFAULT_PORT, origins: Sequence[str] = ALLOWED_ORIGINS
          ) -> Iterator[FoxgloveServer]:
    """Serve ``car`` to Foxglove on this computer only; port 0: any free one.

    Raises UsageError without websockets, and for a port that is in use.
    """
    server = FoxgloveServer(car.recorder.messages(), car.files.config.name)
    server.start(port, origins)
    try:
        yield server
    finally:
        server.stop()


class Client:
    """One connection: its subscriptions by channel, and its queue of unsent messages."""

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        # By channel, the number that the client gave its subscription.
        self.subscriptions: dict[int, int] = {}
        self.advertised = 0
        self.queue: deque[str | bytes] = deque()
        self.queued_bytes = 0
        self.wake = asyncio.Event()

    def queue_message(self, message: str | bytes) -> None:
        """Queue a message; drop data messages if the queue is too long."""
        self.queue.append(message)
        self.queued_bytes += len(message)
        if self.queued_bytes > MAX_BACKLOG_BYTES:
            self.queue = deque(m for m in self.queue if isinstance(m, str))
            self.queued_bytes = sum(map(len, self.queue))
            # Still too long without data: the client sends requests but reads no answers.
            if self.queued_bytes > MAX_BACKLOG_BYTES:
                self.connection.transport.abort()
        self.wake.set()

    async def send(self) -> None:
        """Send queued messages until cancelled; wait while the client does not read."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.queue:
                message = self.queue.popleft()
                self.queued_bytes -= len(message)
                await self.connection.send(message)


class FoxgloveServer:
    """Serves messages at ``port``. ``start`` and ``stop`` must be called by one thread."""

    def __init__(self, file: RunFile, name: str) -> None:
        self._file = file
        self._name = name
        self._clients: set[Client] = set()
        self._subscribed_channels: frozenset[int] = frozenset()
        self._pending: deque[tuple[int, int, bytes]] = deque(maxlen=MAX_PENDING_MESSAGES)
        self._end: Callable[[], object] = lambda: None
        self._closed_error: type[Exception] = ConnectionError
        self._thread: threading.Thread | None = None
        self.port = 0
        self.layout = LAYOUT

    def start(self, port: int, origins: Sequence[str]) -> None:
        """Start to listen. Raises UsageError without websockets or for a port in use."""
        try:
            from websockets.asyncio.server import serve as listen
            from websockets.exceptions import ConnectionClosed
        except ImportError as error:
            raise UsageError("a live server needs websockets", found="websockets is not installed",
                             remedy=install_command("websockets")) from error
        self._closed_error = ConnectionClosed
        failed: list[OSError] = []
        listening = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run(listen, port, origins, listening,
                                                 failed)), name="foxglove", daemon=True)
        self._thread.start()
        listening.wait()
        if failed:
            raise UsageError(f"port {port} cannot be served", found=failed[0].strerror or "",
                             likely="another program uses this port", expected="a free port",
                             remedy=f"--port {port + 1}") from failed[0]
        self._file.taps.append(self._take_message)

    def stop(self) -> None:
        """Close every connection; idempotent."""
        if self._take_message in self._file.taps:
            self._file.taps.remove(self._take_message)
        self._end()
        if self._thread is not None:
            self._thread.join()

    def _take_message(self, channel: int, ns: int, data: bytes) -> None:
        """Queue a message of the drive, if a client subscribed to its channel."""
        if channel in self._subscribed_channels:
            self._pending.append((channel, ns, data))

    async def _run(self, listen: Any, port: int, origins: Sequence[str],
                   listening: threading.Event, failed: list[OSError]) -> None:
        loop = asyncio.get_running_loop()
        end = asyncio.Event()

        def end_loop() -> None:
            # RuntimeError: the loop has ended already.
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(end.set)

        self._end = end_loop
        try:
            server = await listen(self._serve_client, "localhost", port, origins=[None, *origins],
                                  subprotocols=list(protocol.SUBPROTOCOLS),
                                  max_size=MAX_REQUEST_BYTES,
                                  compression=None, close_timeout=0.5)
            self.port = server.sockets[0].getsockname()[1]
        except OSError as error:
            failed.append(error)
            return
        finally:
            listening.set()
        ticking = asyncio.create_task(self._tick())
        await end.wait()
        ticking.cancel()
        server.close()
        await server.wait_closed()

    async def _tick(self) -> None:
        """Distribute new channels and messages to the clients, until cancelled."""
        while True:
            await asyncio.sleep(SEND_PERIOD_S)
            for client in self._clients:
                self._advertise(client)
            while self._pending:
                channel, ns, data = self._pending.popleft()
                for client in self._clients:
                    if (number := client.subscriptions.get(channel)) is not None:
                        client.queue_message(protocol.data(number, ns, data))

    def _advertise(self, client: Client) -> None:
        """Advertise the channels that are new since the last call."""
        if client.advertised < len(self._file.channels):
            channels = dict(list(self._file.channels.items())[client.advertised:])
            client.advertised += len(channels)
            client.queue_message(protocol.advertise(channels, {
                kind: definition(kind).decode() for _, kind in channels.values()}))

    async def _serve_client(self, connection: Any) -> None:
        """Serve one client from its connection to its end."""
        client = Client(connection)
        client.queue_message(protocol.server_info(self._name))
        self._advertise(client)
        self._clients.add(client)
        sending = asyncio.create_task(client.send())
        sending.add_done_callback(lambda task: task.cancelled() or task.exception())
        try:
            while (message := await self._receive(connection)) is not None:
                try:
                    self._handle_request(client, message)
                except MalformedRequest as why:
                    client.queue_message(protocol.status(protocol.ERROR, str(why)))
        finally:
            self._clients.discard(client)
            self._update_channels()
            sending.cancel()

    async def _receive(self, connection: Any) -> str | bytes | None:
        """Return the next message of a client, None if it has disconnected."""
        try:
            message: str | bytes = await connection.recv()
        except self._closed_error:
            return None
        return message

    def _handle_request(self, client: Client, message: str | bytes) -> None:
        """Handle a request of a client. Raises MalformedRequest."""
        if isinstance(message, bytes):
            raise MalformedRequest(READ_ONLY)
        request = protocol.request(message)
        if request["op"] == "subscribe":
            for number, channel in protocol.pairs(request, "subscriptions", "id", "channelId"):
                self._subscribe(client, number, channel)
        elif request["op"] == "unsubscribe":
            ended = request.get("subscriptionIds")
            ended = ended if isinstance(ended, list) else []
            client.subscriptions = {c: n for c, n in client.subscriptions.items() if n not in ended}
        elif request["op"] in ("advertise", "unadvertise"):
            raise MalformedRequest(READ_ONLY)
        else:
            raise MalformedRequest(f"op {request['op'][:40]!r} is not supported")
        self._update_channels()

    def _subscribe(self, client: Client, number: object, channel: object) -> None:
        if _to_u32(channel) not in self._file.channels:
            raise MalformedRequest(f"there is no channel {channel!r}"[:200])
        client.subscriptions[_to_u32(channel)] = _to_u32(number)

    def _update_channels(self) -> None:
        self._subscribed_channels = frozenset(channel for client in self._clients
                                              for channel in client.subscriptions)


def _to_u32(number: object) -> int:
    """Check a number of a channel: u32 in the protocol. Raises MalformedRequest."""
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 1 << 32:
        raise MalformedRequest(f"{number!r} is not the number of a channel"[:200])
    return number
