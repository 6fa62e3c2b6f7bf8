"""The page that flashes a Nano from a browser, as files, and served to this computer alone.

A browser gives its serial ports (Web Serial) only to localhost and to https: the same files lie in
the handbook. They are served without the extra ``view``: a desk with pip alone can flash.
"""

from __future__ import annotations

from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path

PORT = 8643
"""A browser keeps its permissions by address; where it is taken, any free port."""
TYPES = {"html": "text/html; charset=utf-8", "mjs": "text/javascript; charset=utf-8",
         "css": "text/css; charset=utf-8", "hex": "text/plain; charset=us-ascii"}
PAGE, IMAGE = "index.html", "dart_nano.hex"


def assets(image: Path) -> dict[str, bytes]:
    """Name: bytes of each file of the page. image: the Intel hex that it offers."""
    room = files("dart_lab.live.view") / "flash"
    found = {place.name: place.read_bytes() for place in room.iterdir()
             if place.name.rpartition(".")[2] in TYPES}
    return found | {IMAGE: image.read_bytes()}


def serve_flash_page(image: Path) -> ThreadingHTTPServer:
    """A server on localhost that listens; the caller lets it ``serve_forever`` and closes it."""
    served = assets(image)

    class Handler(BaseHTTPRequestHandler):
        """Answers with one of the files."""

        def do_GET(self) -> None:
            name = self.path.partition("?")[0].removeprefix("/") or PAGE
            body = served.get(name)
            if body is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", TYPES[name.rpartition(".")[2]])
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *words: object) -> None:
            """Nothing: who flashes reads the page."""

    try:
        return ThreadingHTTPServer(("127.0.0.1", PORT), Handler)
    except OSError:
        return ThreadingHTTPServer(("127.0.0.1", 0), Handler)
