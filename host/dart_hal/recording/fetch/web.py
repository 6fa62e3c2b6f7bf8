"""Published files from a web address, one by one, or an archive as a whole."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dart_hal.core.errors import FetchFailed

from .published import MANUAL_ADVICE, RETRY_ADVICE, ROOTS

TIMEOUT = 20.0  # s without a byte
ABSENT_STATUS = (404, 410)
Progress = Callable[[int, int, str], None]


class Web:
    """A downloader for pooch below a base address; it first tries the last successful root."""

    def __init__(self, base: str) -> None:
        self.name = self.where = base.rstrip("/")
        self._roots = ["", *ROOTS]

    def __call__(self, path: str, destination: str, store: Any) -> None:
        """Download to ``destination`` from the first address that exists.

        Raises LookupError when there is none, FetchFailed without a network.
        """
        for root in self._roots:
            self.where = "/".join(p for p in (self.name, quote(root), quote(path)) if p)
            if download(self.where, destination):
                # The sort is stable: only this root moves, to the front.
                self._roots.sort(key=lambda r: r != root)
                return
        raise LookupError(path)


class _Bar:
    """Progress bar of pooch that calls ``progress``."""

    def __init__(self, name: str, progress: Progress) -> None:
        self.total = self._done = 0
        self._name = name
        self._progress = progress

    def update(self, count: int) -> None:
        self._done = min(self._done + count, self.total)
        self._progress(self._done, self.total, self._name)

    def reset(self) -> None:
        self._done = 0

    def close(self) -> None:
        """Do nothing: the bar has no resources."""


def download(url: str, destination: str | Path, progress: Progress | None = None) -> bool:
    """Download ``url`` to a file; return False if the server has no such file.

    progress(bytes done, total bytes, name). Errors: FetchFailed.
    """
    import pooch

    bar = _Bar(url.rsplit("/", 1)[-1], progress) if progress else False
    fetcher = pooch.HTTPDownloader(progressbar=bar, timeout=TIMEOUT, chunk_size=1 << 16,
                                   headers={"User-Agent": "dart-hal"})
    try:
        fetcher(url, str(destination), None)
    except OSError as err:  # the base class of the errors of requests
        answer = getattr(err, "response", None)
        if answer is not None and answer.status_code in ABSENT_STATUS:
            return False
        why = err.args[0] if err.args else err
        found = (f"HTTP {answer.status_code} {answer.reason}" if answer is not None
                 else str(getattr(why, "reason", why)).rpartition(": ")[2] or type(err).__name__)
        raise FetchFailed(f"{url} cannot be had", found=found,
                          expected="an answer from the server",
                          likely="no network here, or a server that refuses",
                          remedy=RETRY_ADVICE + MANUAL_ADVICE) from err
    return True
