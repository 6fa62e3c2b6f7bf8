"""A thread that serves the page and its socket; what is said goes to a ``Listener``.

Nothing here waits for a page: what a page does not read in time ends its socket, and no other's.

Strangers may take all ``MOST_PAGES`` sockets. Then a new page takes the place of the one that has
watched longest, but never of the page that drives; the other page says so, and its STOP still
works: STOP needs no socket, it is also a plain HTTP request. ``MAX_HANDSHAKES`` limits connections
that have asked for nothing yet; the oldest of them is closed for a new one.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import time
from collections.abc import Iterable, Sequence
from functools import partial
from http import HTTPStatus
from importlib.resources import files
from math import inf
from typing import Any, Protocol

from websockets.asyncio.server import Server as Socket
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from dart_hal.core.errors import UsageError
from dart_lab.live.view.access import Access
from dart_lab.live.view.messages import LONGEST, Malformed, Message, Stop, read
from dart_lab.live.view.operator import Refused

RATE = 30.0
"""Batches a second."""
MOST_WAITING = 1 << 20
"""Bytes that may wait for a page: 20 s of all there is. One that reads nothing is sent away."""
SEND_BUFFER = 16384
"""Bytes that the kernel keeps for a page, and as much again: news that waits longer is old."""
MOST_PAGES = 50
REPLACED = 4001
"""Code with which a socket is closed whose place a newer page takes."""
MIN_REPLACE_PERIOD_S = 0.2
"""Time between two pages that are replaced: a flood of sockets costs no more of the processor than
the refusal of most of them."""
MAX_HANDSHAKES = 64
"""Connections that have not sent a whole request. Browsers need some ms for that; without a limit
idle connections would take all file descriptors of the program, 1024 by default."""
STOP = "/stop"
STOP_HEADER = "X-Dart-Stop"
"""A request to STOP carries this header, or is a POST of our own page or of no page. A page of
another origin can do neither: browsers ask us before they send such a header, and state the origin
of a POST."""
MOST_MALFORMED = 20
"""Messages that are none, until their page is sent away."""
PICTURE = "/camera.jpg"
"""Each page asks for the newest image once it has drawn the last, on a connection of its own: a
slow one sees fewer of them, and its samples and STOP do not stand behind pictures."""
SILENT = 4.0
"""s without an answer to a ping until a socket counts as gone."""

TYPES = {"html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8",
         "css": "text/css; charset=utf-8"}
VENDOR = ("uPlot.iife.min.js", "uPlot.min.css")
CAR = ("index.html", "style.css", "app.js", "camera.js", "floor.js", "menu.js", "plots.js",
       "player.js", "said.js", "stick.js", "stop.js")
FLEET = ("fleet.html", "style.css", "fleet.js", "floor.js", "said.js", "stop.js")
"""Files of the two pages; the first is the page itself."""
SAFE = {"Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
                                   "img-src 'self' data:; frame-ancestors 'none'",
        "Cross-Origin-Resource-Policy": "same-origin",
        "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store"}

log = logging.getLogger("dart_hal")
_socket_log = logging.getLogger("dart_lab.live.view.sockets")
_socket_log.setLevel(logging.WARNING)
_socket_log.addFilter(lambda record: record.msg != "opening handshake failed")
"""At DEBUG the library would log each message that comes, and so the token. That a stranger's
connection requested nothing is no error of ours."""


class Visitor(ServerConnection):
    """A connection; ``handshakes``: those that have not sent a whole request, the oldest first."""

    def __init__(self, handshakes: dict[ServerConnection, None], *args: Any, **options: Any
                 ) -> None:
        super().__init__(*args, **options)
        self._handshakes = handshakes

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._handshakes[self] = None
        if len(self._handshakes) > MAX_HANDSHAKES:
            oldest = next(iter(self._handshakes))
            del self._handshakes[oldest]
            oldest.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._handshakes.pop(self, None)
        super().connection_lost(exc)


class Listener(Protocol):
    """Whom the pages talk to. All of it is called in the server's thread."""

    def joined(self, page: ServerConnection) -> Iterable[str]:
        """Messages for a page that has just come."""

    def said(self, page: ServerConnection, message: Message) -> str | None:
        """The answer to this page. STOP may come from one that has not joined. Raises Refused."""

    def left(self, page: ServerConnection) -> None:
        """Its socket is closed."""

    def batch(self) -> Iterable[str]:
        """Messages for all pages now; called 30 times a second."""

    def is_driver(self, page: ServerConnection) -> bool:
        """Whether this page drives."""

    def refusal(self, why: str) -> str:
        """The message that tells one page why not."""

    def picture(self) -> bytes | None:
        """The camera's newest image, JPEG; None without one."""


def assets(page: Sequence[str]) -> dict[str, tuple[str, bytes]]:
    """Path of a request: its type and its bytes."""
    room = files("dart_lab.live.view")
    served = {f"/{name}": room / "page" / name for name in page}
    served |= {f"/vendor/{name}": room / "vendor" / name for name in VENDOR}
    found = {path: (TYPES[path.rpartition(".")[2]], place.read_bytes())
             for path, place in served.items()}
    return found | {"/": found[f"/{page[0]}"]}


def bound(port: int, lan: bool) -> socket.socket:
    """A socket that listens; port 0: any. Raises UsageError for a port that is in use."""
    place = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    place.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    try:
        place.bind(("0.0.0.0" if lan else "127.0.0.1", port))
    except OSError as why:
        place.close()
        raise UsageError(f"port {port} cannot be served", found=str(why),
                         expected="a port that no other program has",
                         remedy=f"--port {port + 1}, or --port 0 for any") from why
    return place


class Server:
    """Begins with ``start``; ``close`` ends thread and sockets."""

    def __init__(self, place: socket.socket, access: Access, listener: Listener,
                 page: Sequence[str] = CAR) -> None:
        self._place, self._access, self._listener = place, access, listener
        self._assets = assets(page)
        self._trouble = ""
        self._handshakes: dict[ServerConnection, None] = {}
        self._pages: dict[ServerConnection, None] = {}
        self._replaced_at = -inf
        self._closing: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended: asyncio.Event | None = None
        self._up = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()),
                                        name="dart-hal view", daemon=True)

    def start(self) -> None:
        self._thread.start()
        self._up.wait()

    def close(self) -> None:
        """Idempotent."""
        if self._loop is not None and self._ended is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(timeout=2.0)

    async def _main(self) -> None:
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        async with serve(self._page, sock=self._place, process_request=self._request,
                         origins=[None, *self._access.origins()],  # type: ignore[list-item]
                         max_size=LONGEST, max_queue=16, compression=None, ping_interval=SILENT,
                         ping_timeout=SILENT, close_timeout=0.5, logger=_socket_log,
                         create_connection=partial(  # type: ignore[arg-type]
                             Visitor, self._handshakes)) as sockets:
            self._up.set()
            while not self._ended.is_set():
                self._send(sockets)
                await asyncio.sleep(1.0 / RATE)

    def _send(self, sockets: Socket) -> None:
        try:
            batch = list(self._listener.batch())
        except BaseException as why:  # noqa: BLE001 - what cannot be told must not end the page
            if repr(why) != self._trouble:  # each once: this is called 30 times a second
                self._trouble = repr(why)
                log.error("the live page could not be told: %r", why)
            return
        pages = sockets.connections
        for page in pages:
            if page.transport.get_write_buffer_size() > MOST_WAITING:
                log.warning("a page that does not read is sent away: %s", page.remote_address)
                page.transport.abort()
        for text in batch:
            broadcast(pages, text)

    async def _page(self, page: ServerConnection) -> None:
        malformed = 0
        self._pages[page] = None
        try:
            for text in self._listener.joined(page):
                await page.send(text)
            async for data in page:
                try:
                    if (answer := self._listener.said(page, read(data))) is not None:
                        await page.send(answer)
                except Malformed as why:
                    malformed += 1
                    await page.send(self._listener.refusal(f"not understood: {why}"))
                except Refused as why:
                    await page.send(self._listener.refusal(str(why)))
                    malformed += MOST_MALFORMED if why.away else 0
                if malformed >= MOST_MALFORMED:
                    await page.close(1008, "too much that was refused")
        except ConnectionClosed:
            pass
        finally:
            self._pages.pop(page, None)
            self._listener.left(page)

    def _request(self, page: ServerConnection, request: Request) -> Response | None:
        self._handshakes.pop(page, None)
        if not self._access.own_host(request.headers.get("Host", "")):
            return _answer(HTTPStatus.FORBIDDEN, TYPES["html"],
                           b"open this page by the address that was printed")
        path = request.path.partition("?")[0]
        if path == STOP:
            return self._stop(page, request)
        if path == "/socket":
            if len(page.server.connections) < MOST_PAGES:
                return None
            opens = "Upgrade" in request.headers and self._is_own_origin(request)
            return None if opens and self._replace_viewer() else _answer(
                HTTPStatus.SERVICE_UNAVAILABLE, TYPES["html"], b"too many pages are open")
        if path == PICTURE:
            image = self._listener.picture()
            return _answer(HTTPStatus.NOT_FOUND, TYPES["html"], b"there is no image yet"
                           ) if image is None else _answer(HTTPStatus.OK, "image/jpeg", image)
        kind, body = self._assets.get(path, ("", b""))
        if not kind:
            return _answer(HTTPStatus.NOT_FOUND, TYPES["html"], b"there is no such page")
        return _answer(HTTPStatus.OK, kind, body)

    def _is_own_origin(self, request: Request) -> bool:
        """Whether a request comes from our own page or from a program."""
        origin = request.headers.get("Origin")
        return origin is None or origin in self._access.origins()

    def _replace_viewer(self) -> bool:
        """Close the page that has watched longest; whether a place is free then."""
        now = time.monotonic()
        viewer = next((page for page in self._pages if not self._listener.is_driver(page)), None)
        if viewer is None or now - self._replaced_at < MIN_REPLACE_PERIOD_S:
            return False
        self._replaced_at = now
        del self._pages[viewer]
        closing = asyncio.get_running_loop().create_task(
            viewer.close(REPLACED, "a newer page took this place"))
        self._closing.add(closing)
        closing.add_done_callback(self._closing.discard)
        return True

    def _stop(self, page: ServerConnection, request: Request) -> Response:
        """STOP by a request of its own."""
        post = getattr(request, "method", "GET") == "POST"  # known from websockets 17 on
        if not (STOP_HEADER in request.headers or post) or not self._is_own_origin(request):
            return _answer(HTTPStatus.FORBIDDEN, TYPES["html"],
                           f"STOP is a request with the header {STOP_HEADER}".encode())
        try:
            self._listener.said(page, Stop())
        except Refused as why:
            return _answer(HTTPStatus.CONFLICT, TYPES["html"], str(why).encode())
        return _answer(HTTPStatus.OK, TYPES["html"], b"stopped")


def _answer(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)),
                       "Connection": "close", **SAFE})
    return Response(status.value, status.phrase, headers, body)
