"""The page that flashes a Nano from a browser, served to this computer only.

A browser allows serial ports (Web Serial) only to pages of localhost and https. The same files are
part of the handbook. Serving them needs no optional package.
"""

from __future__ import annotations

from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path

# A fixed port, because a browser stores permissions by address. Any free port if it is in use.
FLASH_PORT = 8643
FLASH_CONTENT_TYPES = {"html": "text/html; charset=utf-8", "mjs": "text/javascript; charset=utf-8",
                       "css": "text/css; charset=utf-8", "hex": "text/plain; charset=us-ascii"}
PAGE = "index.html"
IMAGE = "dart_nano.hex"


def load_flash_assets(image: Path) -> dict[str, bytes]:
    """Return the bytes of each file of the page by name. image: the Intel hex that it offers."""
    folder = files("dart_lab.live.view") / "flash"
    found = {file.name: file.read_bytes() for file in folder.iterdir()
             if file.name.rpartition(".")[2] in FLASH_CONTENT_TYPES}
    return found | {IMAGE: image.read_bytes()}


def serve_flash_page(image: Path) -> ThreadingHTTPServer:
    """Return a server on localhost; the caller runs ``serve_forever`` and closes it."""
    served = load_flash_assets(image)

    class Handler(BaseHTTPRequestHandler):
        """Answers with a file of the page."""

        def do_GET(self) -> None:
            name = self.path.partition("?")[0].removeprefix("/") or PAGE
            body = served.get(name)
            if body is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", FLASH_CONTENT_TYPES[name.rpartition(".")[2]])
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *words: object) -> None:
            """Log nothing: the page shows all that the user needs."""

    try:
        return ThreadingHTTPServer(("127.0.0.1", FLASH_PORT), Handler)
    except OSError:
        return ThreadingHTTPServer(("127.0.0.1", 0), Handler)
