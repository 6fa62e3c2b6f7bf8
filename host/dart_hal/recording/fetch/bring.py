"""Download the published recordings; pooch checks each against its SHA-256.

Complete files are not downloaded again, so an interrupted download resumes. A wrong file is refused
and not kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dart_hal.core.errors import FetchFailed

from .folder import data_folder
from .local import Local
from .published import ARCHIVE_URL, MANUAL_ADVICE, NOTICE, RAW_URL, RETRY_ADVICE, load
from .web import Progress, Web, download

ARCHIVES = (".zip", ".tar.gz", ".tgz", ".tar")


@dataclass(frozen=True, slots=True)
class RefusedFile:
    """A received file that is not the published one."""

    path: str
    where: str
    found: str


@dataclass(slots=True)
class FetchOutcome:
    """Result of a download. Lists have paths of the published list."""

    to: Path
    files: int
    sources: list[str] = field(default_factory=list)
    present: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    refused: list[RefusedFile] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Whether all published files are complete."""
        return len(self.present) + len(self.fetched) == self.files

    def to_json(self) -> dict[str, Any]:
        """Return the object of ``data fetch --json``."""
        return {**asdict(self), "to": str(self.to), "complete": self.complete,
                "present": len(self.present)}


def _quiet(done: int, total: int, name: str) -> None:
    """Show no progress."""


def fetch(source: str | None = None, folder: str | Path | None = None, *,
          registry: Mapping[str, str] | None = None, progress: Progress = _quiet) -> FetchOutcome:
    """Download the missing files into ``folder`` (default ``data_folder()``).

    source: a folder of any layout, an archive (.zip, .tar.gz) or the address
    of one, a base address; None = the repository at the listed commit.
    registry: SHA-256 by path, default: the published set. progress(done, total,
    name): files, or bytes of an archive. Errors: FetchFailed if the source is not available, or
    has none of the missing files.
    """
    import pooch

    pooch.get_logger().setLevel("WARNING")
    target = Path(folder) if folder is not None else data_folder()
    store = pooch.Pooch(target, "", registry=dict(registry or load()))
    outcome = FetchOutcome(target, len(store.registry))
    progress(0, outcome.files, "checking the present files")
    outcome.present = [path for path, known in store.registry.items()
                       if (target / path).is_file() and pooch.file_hash(target / path) == known]
    left = [path for path in store.registry if path not in outcome.present]
    fresh = not target.exists()
    try:
        with TemporaryDirectory(prefix="dart-hal-") as scratch:
            # Source by source: a file that one of them lacks, or has with another checksum, is
            # searched for in the next.
            for one in _sources(source, store.registry, Path(scratch), progress) if left else ():
                outcome.sources.append(one.name)
                for path in left:
                    progress(outcome.files - len(left), outcome.files, path)
                    _take(path, one, store, outcome)
                left = [path for path in left if path not in outcome.fetched]
                if not left:
                    break
    finally:
        if fresh and not outcome.fetched:
            # An empty data folder would count as one with recordings.
            shutil.rmtree(target, ignore_errors=True)
    outcome.refused = [r for r in outcome.refused if r.path in left]
    outcome.missing = [path for path in left if path not in {r.path for r in outcome.refused}]
    if left and not (outcome.fetched or outcome.present):
        raise _nothing_found(outcome)
    if outcome.fetched and not (target / "LICENSE").exists():
        shutil.copyfile(NOTICE, target / "LICENSE")  # it must accompany every copy
    return outcome


def _take(path: str, source: Web | Local, store: Any, outcome: FetchOutcome) -> None:
    """Download one file completely or not at all; keep another one as ``NAME.old``."""
    received = b""

    def download_file(url: str, destination: str, store: Any) -> None:
        nonlocal received
        source(url, destination, store)
        received = Path(destination).read_bytes()

    target = store.abspath / path
    old = target.rename(target.with_name(target.name + ".old")) if target.is_file() else None
    try:
        store.fetch(path, downloader=download_file)
        outcome.fetched.append(path)
        outcome.replaced += [path] if old else []
        old = None
    except LookupError:
        pass
    except ValueError:  # pooch: not the known checksum
        found = _describe(received, store.registry[path])
        outcome.refused.append(RefusedFile(path, source.where, found))
    finally:
        if old:
            old.rename(target)


def _describe(data: bytes, known: str) -> str:
    """Describe a wrong file, for the message."""
    if data.lstrip()[:1] == b"<":
        return "a web page"
    return f"{len(data)} bytes of SHA-256 {sha256(data).hexdigest()[:12]}..., not {known[:12]}..."


def _sources(source: str | None, registry: Mapping[str, str], scratch: Path, progress: Progress
             ) -> Iterator[Web | Local]:
    """Yield the sources, to be tried in turn until no file is missing."""
    if source is None:
        yield Web(RAW_URL)
        yield _from_archive(ARCHIVE_URL, registry, scratch, progress)
    elif not source.startswith(("http://", "https://")):
        path = Path(source).expanduser()
        if not path.exists():
            raise FetchFailed(f"{source}: no such folder or archive", found="nothing there",
                              expected="a folder, a .zip or .tar.gz, or an http(s) address",
                              remedy=MANUAL_ADVICE)
        yield Local(path, str(path), registry)
    elif source.lower().partition("?")[0].endswith(ARCHIVES):
        yield _from_archive(source, registry, scratch, progress)
    else:
        yield Web(source)


def _from_archive(url: str, registry: Mapping[str, str], scratch: Path, progress: Progress
                  ) -> Local:
    if not download(url, scratch / "archive", progress):
        raise FetchFailed(f"{url} cannot be had", found="the server has no such file",
                          expected="an archive of the repository",
                          remedy=RETRY_ADVICE + MANUAL_ADVICE)
    return Local(scratch / "archive", url, registry)


def _nothing_found(outcome: FetchOutcome) -> FetchFailed:
    first = outcome.refused[0] if outcome.refused else None
    return FetchFailed(
        f"none of the {outcome.files} published recordings in {', '.join(outcome.sources)}",
        found=f"{len(outcome.refused)} file(s) of the right name but other content, as "
              f"{first.where}: {first.found}" if first else "no file of that name or content",
        expected="the recordings of Lorenzo-Lyons/DART, unchanged", remedy=MANUAL_ADVICE)
