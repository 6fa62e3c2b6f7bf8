"""A server of an open car's messages: a thread of its own that takes nothing from the drive.

The drive hands a message over and goes on; every ``TICK`` the thread gives what came to the
clients. Each has a queue of its own, which is emptied when it grows: one that stalls delays
nobody.
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
from dart_lab.live.foxglove.protocol import Malformed

PORT = 8765
"""Where Foxglove looks by default."""
ORIGINS = ("https://app.foxglove.dev", "http://localhost:8080")
"""Pages that may connect: Foxglove's, and a Lichtblick of one's own. A page of anybody else that
is open in the same browser may not; programs, which send no Origin, may."""
TICK = 0.02
"""s between two looks at what came: a message is at most that old."""
BACKLOG = 8 << 20
"""Bytes that a client may be behind, some 40 s of all channels; then it loses them."""
MOMENT = 4000
"""Messages within one tick: some 4 s of all channels."""
LARGEST = 1 << 16
"""Bytes of a client's message; a longer one ends its connection."""
READ_ONLY = "this server is read-only: drive by the live page, a gamepad or a program"


class Messages(Protocol):
    """Where the messages of a car pass (``car.Recorder``)."""

    def messages(self) -> RunFile: ...


class LiveCar(Protocol):
    """What is served of a ``Car``."""

    @property
    def files(self) -> CarFiles: ...
    @property
    def recorder(self) -> Messages: ...


@contextmanager
def serve(car: LiveCar, *, port: int = PORT, origins: Sequence[str] = ORIGINS
          ) -> Iterator[Server]:
    """Serve ``car`` to Foxglove on this computer alone; port 0: any that is free.

    Raises UsageError without websockets, and for a port that is in use.
    """
    server = Server(car.recorder.messages(), car.files.config.name)
    server.start(port, origins)
    try:
        yield server
    finally:
        server.stop()


class Client:
    """One connection: subscriptions by channel, what it has not been sent yet."""

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        self.subscriptions: dict[int, int] = {}  # channel: the client's own number
        self.advertised = 0
        self.queue: deque[str | bytes] = deque()
        self.behind = 0  # bytes
        self.wake = asyncio.Event()

    def tell(self, message: str | bytes) -> None:
        self.queue.append(message)
        self.behind += len(message)
        if self.behind > BACKLOG:
            self.queue = deque(m for m in self.queue if isinstance(m, str))
            self.behind = sum(map(len, self.queue))
            if self.behind > BACKLOG:  # it asks and does not read the answers
                self.connection.transport.abort()
        self.wake.set()

    async def send(self) -> None:
        """Send what is queued, for ever; waits where the client does not read."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.queue:
                message = self.queue.popleft()
                self.behind -= len(message)
                await self.connection.send(message)


class Server:
    """``port``: where it listens. ``start`` and ``stop`` are called by one thread."""

    def __init__(self, file: RunFile, name: str) -> None:
        self._file, self._name = file, name
        self._clients: set[Client] = set()
        self._wanted: frozenset[int] = frozenset()
        self._came: deque[tuple[int, int, bytes]] = deque(maxlen=MOMENT)
        self._ended: Callable[[], object] = lambda: None
        self._closed: type[Exception] = ConnectionError
        self._thread: threading.Thread | None = None
        self.port = 0
        self.layout = LAYOUT

    def start(self, port: int, origins: Sequence[str]) -> None:
        """Listen. Raises UsageError."""
        try:
            from websockets.asyncio.server import serve as listen
            from websockets.exceptions import ConnectionClosed
        except ImportError as error:
            raise UsageError("a live server needs websockets", found="it is not installed",
                             remedy=install_command("websockets")) from error
        self._closed = ConnectionClosed
        failed: list[OSError] = []
        listening = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run(listen, port, origins, listening,
                                                 failed)), name="foxglove", daemon=True)
        self._thread.start()
        listening.wait()
        if failed:
            raise UsageError(f"port {port} cannot be served", found=failed[0].strerror or "",
                             likely="another program serves there", expected="a free port",
                             remedy=f"--port {port + 1}") from failed[0]
        self._file.taps.append(self._hear)

    def stop(self) -> None:
        """Close every connection; idempotent."""
        if self._hear in self._file.taps:
            self._file.taps.remove(self._hear)
        self._ended()
        if self._thread is not None:
            self._thread.join()

    def _hear(self, channel: int, ns: int, data: bytes) -> None:
        """By whoever drives: the newest are kept."""
        if channel in self._wanted:
            self._came.append((channel, ns, data))

    async def _run(self, listen: Any, port: int, origins: Sequence[str],
                   listening: threading.Event, failed: list[OSError]) -> None:
        loop, end = asyncio.get_running_loop(), asyncio.Event()

        def ended() -> None:
            with suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(end.set)

        self._ended = ended
        try:
            server = await listen(self._attend, "localhost", port, origins=[None, *origins],
                                  subprotocols=list(protocol.SUBPROTOCOLS), max_size=LARGEST,
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
        while True:
            await asyncio.sleep(TICK)
            for client in self._clients:
                self._advertise(client)
            while self._came:
                channel, ns, data = self._came.popleft()
                for client in self._clients:
                    if (number := client.subscriptions.get(channel)) is not None:
                        client.tell(protocol.data(number, ns, data))

    def _advertise(self, client: Client) -> None:
        """Channels that have come into being since the last time."""
        if client.advertised < len(self._file.channels):
            channels = dict(list(self._file.channels.items())[client.advertised:])
            client.advertised += len(channels)
            client.tell(protocol.advertise(channels, {
                kind: definition(kind).decode() for _, kind in channels.values()}))

    async def _attend(self, connection: Any) -> None:
        """One client, from its opening to its end."""
        client = Client(connection)
        client.tell(protocol.server_info(self._name))
        self._advertise(client)
        self._clients.add(client)
        sending = asyncio.create_task(client.send())
        sending.add_done_callback(lambda task: task.cancelled() or task.exception())
        try:
            while (message := await self._next(connection)) is not None:
                try:
                    self._take(client, message)
                except Malformed as why:
                    client.tell(protocol.status(protocol.ERROR, str(why)))
        finally:
            self._clients.discard(client)
            self._count_wanted()
            sending.cancel()

    async def _next(self, connection: Any) -> str | bytes | None:
        """What a client sends next; None: it is gone."""
        try:
            message: str | bytes = await connection.recv()
        except self._closed:
            return None
        return message

    def _take(self, client: Client, message: str | bytes) -> None:
        """What a client sent. Raises Malformed."""
        if isinstance(message, bytes):
            raise Malformed(READ_ONLY)
        request = protocol.request(message)
        if request["op"] == "subscribe":
            for number, channel in protocol.pairs(request, "subscriptions", "id", "channelId"):
                self._subscribe(client, number, channel)
        elif request["op"] == "unsubscribe":
            gone = request.get("subscriptionIds")
            gone = gone if isinstance(gone, list) else []
            client.subscriptions = {c: n for c, n in client.subscriptions.items() if n not in gone}
        elif request["op"] in ("advertise", "unadvertise"):
            raise Malformed(READ_ONLY)
        else:
            raise Malformed(f"op {request['op'][:40]!r} is not served")
        self._count_wanted()

    def _subscribe(self, client: Client, number: object, channel: object) -> None:
        if _whole(channel) not in self._file.channels:
            raise Malformed(f"there is no channel {channel!r}"[:200])
        client.subscriptions[_whole(channel)] = _whole(number)

    def _count_wanted(self) -> None:
        self._wanted = frozenset(c for client in self._clients for c in client.subscriptions)


def _whole(number: object) -> int:
    """A channel's number: u32 in the protocol. Raises Malformed."""
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < 1 << 32:
        raise Malformed(f"{number!r} is no number of a channel"[:200])
    return number
