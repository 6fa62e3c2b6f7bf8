"""Published files from a web address, one by one, or an archive as a whole."""

from __future__ import annotations

import http.client
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.parse import quote
from urllib.request import Request, urlopen

from dart_hal.errors import FetchFailed

from .manifest import COMMIT, REPOSITORY, Published
from .sources import Offer

TIMEOUT = 20.0  # s without a byte
CHUNK = 1 << 16
LARGEST_ARCHIVE = 4 << 30  # bytes
RAW = REPOSITORY.replace("https://github.com", "https://raw.githubusercontent.com") + f"/{COMMIT}"
ARCHIVE = f"{REPOSITORY}/archive/{COMMIT}.zip"
BY_HAND = (f"git clone {REPOSITORY} ; dart-hal data fetch --from DART"
           " ; or set $DART_DATA to a folder that has them")
AGAIN = "the same command goes on where it stopped ; or "


class Web:
    """Files below a base address; each root folder is tried, the last that worked first."""

    def __init__(self, base: str, roots: Sequence[str]) -> None:
        self.name = base.rstrip("/")
        self._roots = ["", *roots]

    def get(self, wanted: Published) -> Offer:
        """The answer of the first address that exists. Errors: FetchFailed without a network."""
        for root in list(self._roots):
            url = "/".join(p for p in (self.name, quote(root), quote(wanted.path)) if p)
            data = _download(url, wanted.size + 1)
            if data is not None:
                self._roots.remove(root)
                self._roots.insert(0, root)
                return Offer(data, url)
        return Offer(None, self.name)


def _download(url: str, most: int) -> bytes | None:
    """At most ``most`` bytes of ``url``; None when the server says that it is not there."""
    try:
        with _open(url) as answer:
            return bytes(answer.read(most))
    except HTTPError as err:
        if err.code in (404, 410):
            return None
        raise _unreachable(url, f"HTTP {err.code} {err.reason}") from err
    except http.client.IncompleteRead as err:
        return bytes(err.partial)
    except (OSError, http.client.HTTPException) as err:
        raise _unreachable(url, str(getattr(err, "reason", err)) or type(err).__name__) from err


def _open(url: str) -> http.client.HTTPResponse:
    request = Request(url, headers={"User-Agent": "dart-hal"})
    answer: http.client.HTTPResponse = urlopen(request, timeout=TIMEOUT)
    return answer


@contextmanager
def downloaded(url: str, progress: Callable[[int, int, str], None]) -> Iterator[Path]:
    """``url`` in a temporary file, which is gone afterwards. Errors: FetchFailed."""
    with tempfile.TemporaryDirectory(prefix="dart-hal-") as place:
        path = Path(place) / "archive"
        try:
            with _open(url) as answer, path.open("wb") as out:
                total = int(answer.headers.get("Content-Length") or 0)
                done = 0
                while chunk := answer.read(CHUNK):
                    done += len(chunk)
                    if done > LARGEST_ARCHIVE:
                        raise _unreachable(url, "more than 4 GB")
                    out.write(chunk)
                    progress(done, max(total, done), url.rsplit("/", 1)[-1])
        except (URLError, http.client.HTTPException, TimeoutError, ConnectionError) as err:
            raise _unreachable(url, str(getattr(err, "reason", err))) from err
        yield path


def _unreachable(url: str, why: str) -> FetchFailed:
    return FetchFailed(f"{url} cannot be had", found=why, expected="an answer from the server",
                       likely="no network here, or a server that refuses",
                       remedy=AGAIN + BY_HAND)
