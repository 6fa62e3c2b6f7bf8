"""Thread that serves a page and its sockets; messages go to a ``PageListener``.

Nothing here waits for a page: a page that does not read in time is disconnected, without an effect
on others.

If all MAX_PAGES sockets are in use, a new page replaces the one that has been open longest, but
never the page that drives. The replaced page reports it, and its STOP still works, because STOP is
also a plain HTTP request without a socket. MAX_HANDSHAKES limits connections that have not sent a
request yet; the oldest one is closed for a new one.
"""

from __future__ import annotations

import asyncio
import logging
import re
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
from dart_lab.live.view.messages import (
    MAX_MESSAGE_BYTES,
    MalformedMessage,
    Message,
    Stop,
    parse_message,
)
from dart_lab.live.view.operator import Refused

# Batches of messages per second.
BATCH_RATE_HZ = 30.0
# Unsent bytes of a page: 20 s of all messages. A page that reads nothing is disconnected.
MAX_WAITING_BYTES = 1 << 20
# Characters of a long message that are sent at once.
PART_LENGTH = 1 << 16
# Send buffer of the kernel (it doubles the number). It is small, so that data do not get old in
# it.
SEND_BUFFER = 16384
MAX_PAGES = 50
# Close code of a socket that a newer page replaces.
REPLACED = 4001
# Time between two replaced pages. During a flood of sockets most are refused, which is cheap.
MIN_REPLACE_PERIOD_S = 0.2
# Connections that have not sent a complete request. Browsers need some ms for it. Without a
# limit, idle connections could take all file descriptors of the program, 1024 by default.
MAX_HANDSHAKES = 64
STOP_PATH = "/stop"
# A STOP request has this header, or is a POST of our own page or of a program. A page of another
# origin can do neither: browsers request permission before they send such a header, and state the
# origin of a POST.
STOP_HEADER = "X-Dart-Stop"
# Invalid messages until a page is disconnected.
MAX_MALFORMED = 20
# Each page requests the newest image after it has drawn the last one, on a separate connection.
# A slow page gets fewer images, and images do not delay samples and STOP.
PICTURE_PATH = "/camera.jpg"
# Time without an answer to a ping until a socket counts as closed.
PING_TIMEOUT_S = 4.0
CONTENT_TYPES = {"html": "text/html; charset=utf-8", "js": "text/javascript; charset=utf-8",
                 "css": "text/css; charset=utf-8"}
VENDOR_FILES = ("uPlot.iife.min.js", "uPlot.min.css")
# Files of the two pages; the first one is the HTML page.
CAR_PAGE_FILES = ("index.html", "style.css", "app.js", "camera.js", "floor.js", "menu.js",
                  "plots.js",
                  "player.js", "said.js", "stick.js", "stop.js")
FLEET_PAGE_FILES = ("fleet.html", "style.css", "fleet.js", "floor.js", "said.js", "stop.js")
SECURITY_HEADERS = {"Content-Security-Policy": "default-src 'self'; style-src 'self' "
                                               "'unsafe-inline'; "
                                               "img-src 'self' data:; frame-ancestors 'none'",
                    "Cross-Origin-Resource-Policy": "same-origin",
                    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer",
                    "Cache-Control": "no-store"}

log = logging.getLogger("dart_hal")
# At level DEBUG the library would log each message, including the token. A connection without a
# request is no error of this program.
_socket_log = logging.getLogger("dart_lab.live.view.sockets")
_socket_log.setLevel(logging.WARNING)
_socket_log.addFilter(lambda record: record.msg != "opening handshake failed")


class Visitor(ServerConnection):
    """A connection; ``handshakes``: those without a complete request, the oldest first."""

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


class PageListener(Protocol):
    """Handler of the pages. All methods are called in the thread of the server."""

    def open_page(self, page: ServerConnection) -> Iterable[str]:
        """Return the messages for a page that has just connected."""

    def handle_message(self, page: ServerConnection, message: Message) -> str | None:
        """Return the answer to a page; STOP may come from one not connected. Raises Refused."""

    def close_page(self, page: ServerConnection) -> None:
        """Handle the closed socket of a page."""

    def batch(self) -> Iterable[str]:
        """Return the messages for all pages; called 30 times a second."""

    def is_driver(self, page: ServerConnection) -> bool:
        """Return whether this page drives."""

    def refusal(self, why: str) -> str:
        """Return the message to a page with the reason of a refusal."""

    def picture(self) -> bytes | None:
        """Return the newest image of the camera, JPEG; None without one."""


def strip_comments(path: str, body: bytes) -> bytes:
    """Return a file as it is sent: a script of this project without its lines of comments.

    They are a tenth of the scripts, and a phone on the lab's radio loads all of them.
    """
    if not path.endswith(".js") or path.startswith("/vendor/"):
        return body
    return re.sub(rb"(?m)^ *//.*\n", b"", body)


def load_assets(page: Sequence[str]) -> dict[str, tuple[str, bytes]]:
    """Return type and bytes of each file by the path of its request."""
    package = files("dart_lab.live.view")
    served = {f"/{name}": package / "page" / name for name in page}
    served |= {f"/vendor/{name}": package / "vendor" / name for name in VENDOR_FILES}
    found = {path: (CONTENT_TYPES[path.rpartition(".")[2]],
                    strip_comments(path, place.read_bytes()))
             for path, place in served.items()}
    return found | {"/": found[f"/{page[0]}"]}


def bind_socket(port: int, lan: bool) -> socket.socket:
    """Return a bound socket; port 0: any. Raises UsageError for a port that is in use."""
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


class PageServer:
    """Serves a page from ``start`` until ``close``."""

    def __init__(self, place: socket.socket, access: Access, listener: PageListener,
                 page: Sequence[str] = CAR_PAGE_FILES) -> None:
        self._socket = place
        self._access = access
        self._listener = listener
        self._assets = load_assets(page)
        self._last_error = ""
        self._handshakes: dict[ServerConnection, None] = {}
        self._pages: dict[ServerConnection, None] = {}
        self._replaced_at = -inf
        self._closing: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None
        self._started = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()),
                                        name="dart-hal view", daemon=True)

    def start(self) -> None:
        self._thread.start()
        self._started.wait()

    def close(self) -> None:
        """End the server; wait for its thread. Idempotent."""
        if self._loop is not None and self._end is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(timeout=2.0)

    async def _main(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._end = asyncio.Event()
        async with serve(self._serve_page, sock=self._socket, process_request=self._answer_request,
                         max_size=MAX_MESSAGE_BYTES, max_queue=16, compression=None,
                         ping_interval=PING_TIMEOUT_S,
                         ping_timeout=PING_TIMEOUT_S, close_timeout=0.5, logger=_socket_log,
                         create_connection=partial(  # type: ignore[arg-type]
                             Visitor, self._handshakes)) as sockets:
            self._started.set()
            while not self._end.is_set():
                self._send_batch(sockets)
                await asyncio.sleep(1.0 / BATCH_RATE_HZ)

    def _send_batch(self, sockets: Socket) -> None:
        try:
            batch = list(self._listener.batch())
        except BaseException as why:  # noqa: BLE001 - an error in a batch must not end the page
            # Log each error once: this is called 30 times a second.
            if repr(why) != self._last_error:
                self._last_error = repr(why)
                log.error("the live page could not be updated: %r", why)
            return
        pages = sockets.connections
        for page in pages:
            if page.transport.get_write_buffer_size() > MAX_WAITING_BYTES:
                log.warning("a page that does not read is disconnected: %s", page.remote_address)
                page.transport.abort()
        for text in batch:
            broadcast(pages, text)

    async def _serve_page(self, page: ServerConnection) -> None:
        malformed = 0
        self._pages[page] = None
        try:
            for text in self._listener.open_page(page):
                # A run may have tens of megabytes: in parts, a slow reader is waited for, and is
                # not one that does not read.
                await page.send([text[i:i + PART_LENGTH]
                                 for i in range(0, len(text), PART_LENGTH)])
            async for data in page:
                try:
                    if (answer := self._listener.handle_message(page,
                                                                parse_message(data))) is not None:
                        await page.send(answer)
                except MalformedMessage as why:
                    malformed += 1
                    await page.send(self._listener.refusal(f"invalid message: {why}"))
                except Refused as why:
                    await page.send(self._listener.refusal(str(why)))
                    malformed += MAX_MALFORMED if why.away else 0
                if malformed >= MAX_MALFORMED:
                    await page.close(1008, "too many refused messages")
        except ConnectionClosed:
            pass
        finally:
            self._pages.pop(page, None)
            self._listener.close_page(page)

    def _answer_request(self, page: ServerConnection, request: Request) -> Response | None:
        self._handshakes.pop(page, None)
        if not self._access.is_own_host(request.headers.get("Host", ""), _arrived_at(page)):
            return _answer(HTTPStatus.FORBIDDEN, CONTENT_TYPES["html"],
                           b"open this page by the address that was printed")
        path = request.path.partition("?")[0]
        if path == STOP_PATH:
            return self._answer_stop(page, request)
        if path == "/socket":
            if not self._is_own_origin(page, request):
                return _answer(HTTPStatus.FORBIDDEN, CONTENT_TYPES["html"],
                               b"a page of another address may not open this socket")
            if len(page.server.connections) < MAX_PAGES:
                return None
            return None if "Upgrade" in request.headers and self._replace_viewer() else _answer(
                HTTPStatus.SERVICE_UNAVAILABLE, CONTENT_TYPES["html"], b"too many pages are open")
        if path == PICTURE_PATH:
            image = self._listener.picture()
            return _answer(HTTPStatus.NOT_FOUND, CONTENT_TYPES["html"], b"there is no image yet"
                           ) if image is None else _answer(HTTPStatus.OK, "image/jpeg", image)
        kind, body = self._assets.get(path, ("", b""))
        if not kind:
            return _answer(HTTPStatus.NOT_FOUND, CONTENT_TYPES["html"], b"there is no such page")
        return _answer(HTTPStatus.OK, kind, body)

    def _is_own_origin(self, page: ServerConnection, request: Request) -> bool:
        """Return whether a request is from our own page or from a program."""
        origin = request.headers.get("Origin")
        return origin is None or self._access.is_own_origin(origin, _arrived_at(page))

    def _replace_viewer(self) -> bool:
        """Close the page that has been open longest; return whether that was possible."""
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

    def _answer_stop(self, page: ServerConnection, request: Request) -> Response:
        """Answer a STOP request, which needs no socket."""
        # The attribute exists from websockets 17 on.
        post = getattr(request, "method", "GET") == "POST"
        if not (STOP_HEADER in request.headers or post) or not self._is_own_origin(page, request):
            return _answer(HTTPStatus.FORBIDDEN, CONTENT_TYPES["html"],
                           f"STOP is a request with the header {STOP_HEADER}".encode())
        try:
            self._listener.handle_message(page, Stop())
        except Refused as why:
            return _answer(HTTPStatus.CONFLICT, CONTENT_TYPES["html"], str(why).encode())
        return _answer(HTTPStatus.OK, CONTENT_TYPES["html"], b"stopped")


def _arrived_at(page: ServerConnection) -> str:
    """Return the address of this computer at which a connection has arrived."""
    return str((page.transport.get_extra_info("sockname") or ("",))[0])


def _answer(status: HTTPStatus, kind: str, body: bytes) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)),
                       "Connection": "close", **SECURITY_HEADERS})
    return Response(status.value, status.phrase, headers, body)
