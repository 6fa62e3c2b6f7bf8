"""Bring the published recordings into a folder, each checked against its SHA-256.

What is there and right is left alone, so a run that was stopped goes on where
it was; a wrong file is refused and never kept.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dart_hal.errors import FetchFailed

from .folder import data_folder
from .manifest import NOTICE, Manifest, Published, load, sha256
from .sources import ARCHIVES, Source, archive, folder
from .web import ARCHIVE, BY_HAND, RAW, Web, downloaded

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Refusal:
    """A file that came but is not the published one."""

    path: str
    where: str
    found: str


@dataclass(slots=True)
class Outcome:
    """What a fetch did. Lists hold paths of the manifest."""

    to: Path
    files: int
    sources: list[str] = field(default_factory=list)
    present: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    refused: list[Refusal] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Every published file is there and right."""
        return len(self.present) + len(self.fetched) == self.files

    def to_json(self) -> dict[str, Any]:
        """The object of ``data fetch --json``."""
        return {"to": str(self.to), "sources": self.sources, "files": self.files,
                "complete": self.complete, "present": len(self.present),
                "fetched": self.fetched, "replaced": self.replaced,
                "refused": [{"path": r.path, "where": r.where, "found": r.found}
                            for r in self.refused], "missing": self.missing}


def _quiet(done: int, total: int, name: str) -> None:
    """No progress shown."""


def fetch(source: str | None = None, to: str | Path | None = None, *,
          manifest: Manifest | None = None, progress: Progress = _quiet) -> Outcome:
    """Complete ``to`` (default ``data_folder()``) from ``source``.

    source: a folder of any layout, an archive (.zip, .tar.gz) or the address
    of one, a base address; None = the repository at the commit of the
    manifest. progress(bytes done, bytes in all, name). Errors: FetchFailed
    when the source cannot be had, or holds none of the files that lack.
    """
    listed = manifest or load()
    target = Path(to) if to is not None else data_folder()
    outcome = Outcome(target, len(listed.files))
    wanted = _not_yet(listed, target, outcome, progress)
    have = listed.size - sum(f.size for f in wanted)
    for opened in _sources(source, listed, progress):
        if not wanted:
            break
        with opened as one:
            outcome.sources.append(one.name)
            left = []
            for file in wanted:
                progress(have, listed.size, file.path)
                if _take(file, one, target, outcome):
                    have += file.size
                else:
                    left.append(file)
            wanted = left
    refused = {r.path for r in outcome.refused}
    outcome.missing = [f.path for f in wanted if f.path not in refused]
    outcome.refused = [r for r in outcome.refused if r.path in {f.path for f in wanted}]
    if wanted and not (outcome.fetched or outcome.present):
        raise _nothing(outcome)
    if outcome.fetched:
        _notice(target)
    return outcome


def _not_yet(listed: Manifest, target: Path, outcome: Outcome, progress: Progress
             ) -> list[Published]:
    wanted = []
    for file in listed.files:
        progress(0, listed.size, "checking what is there")
        path = target / file.path
        if path.is_file() and path.stat().st_size == file.size \
                and sha256(path.read_bytes()) == file.sha256:
            outcome.present.append(file.path)
        else:
            wanted.append(file)
    return wanted


def _take(file: Published, source: Source, target: Path, outcome: Outcome) -> bool:
    data, where = source.get(file)
    if data is None:
        return False
    if sha256(data) != file.sha256:
        outcome.refused.append(Refusal(file.path, where, _described(data, file)))
        return False
    if _write(target / file.path, data):
        outcome.replaced.append(file.path)
    outcome.fetched.append(file.path)
    return True


def _described(data: bytes, file: Published) -> str:
    """What came instead, for the message."""
    if data.lstrip()[:1] == b"<":
        return "a web page"
    if len(data) < file.size:
        return f"{len(data)} of {file.size} bytes"
    if len(data) > file.size:
        return f"more than {file.size} bytes"
    return f"SHA-256 {sha256(data)[:12]}..., not {file.sha256[:12]}..."


def _write(path: Path, data: bytes) -> bool:
    """Whole or not at all; True if another file of that name was moved to ``NAME.old``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.write_bytes(data)
        other = path.is_file()
        if other:
            os.replace(path, path.with_name(path.name + ".old"))
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return other


def _notice(target: Path) -> None:
    """The licence asks to stay with every copy."""
    path = target / "LICENSE"
    if not path.exists():
        _write(path, NOTICE.read_bytes())


@contextmanager
def _one(source: Source) -> Iterator[Source]:
    yield source


@contextmanager
def _from_archive(url: str, progress: Progress) -> Iterator[Source]:
    with ExitStack() as stack:
        path = stack.enter_context(downloaded(url, progress))
        yield stack.enter_context(archive(path, url))


def _sources(source: str | None, listed: Manifest, progress: Progress) -> Iterator[Any]:
    """Context managers, to be opened in turn until nothing is missing."""
    if source is None:
        yield _one(Web(RAW, listed.roots))
        yield _from_archive(ARCHIVE, progress)
    elif source.startswith(("http://", "https://")):
        if source.lower().partition("?")[0].endswith(ARCHIVES):
            yield _from_archive(source, progress)
        else:
            yield _one(Web(source, listed.roots))
    else:
        path = Path(source).expanduser()
        if path.is_dir():
            yield _one(folder(path))
        elif path.is_file():
            yield archive(path, str(path))
        else:
            raise FetchFailed(f"{source}: no such folder or archive", found="nothing there",
                              expected="a folder, a .zip or .tar.gz, or an http(s) address",
                              remedy=BY_HAND)


def _nothing(outcome: Outcome) -> FetchFailed:
    first = outcome.refused[0] if outcome.refused else None
    return FetchFailed(
        f"none of the {outcome.files} published recordings in {', '.join(outcome.sources)}",
        found=f"{len(outcome.refused)} file(s) of the right name but other content, as "
              f"{first.where}: {first.found}" if first else "no file of that name or content",
        expected="the recordings of Lorenzo-Lyons/DART, unchanged", remedy=BY_HAND)
