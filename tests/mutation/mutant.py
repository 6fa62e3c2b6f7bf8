"""One changed place of one file, and which of many are tried."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Mutant:
    """``text`` is the whole changed file; ``line`` the first line that differs."""

    file: str
    line: int
    operator: str
    before: str
    after: str
    text: str = field(repr=False)

    @property
    def place(self) -> str:
        return f"{self.file}:{self.line}"


def make_mutant(file: str, operator: str, old: str, new: str) -> Mutant | None:
    """The mutant that turns the text ``old`` of a file into ``new``; None if nothing differs."""
    olds = old.splitlines()
    news = new.splitlines()
    for number, (a, b) in enumerate(zip_longest(olds, news, fillvalue=""), 1):
        if a != b:
            return Mutant(file, number, operator, a.strip(), b.strip(), new)
    return None


def chosen(mutants: Iterable[Mutant], count: int) -> list[Mutant]:
    """``count`` mutants, spread over the files, at most one of a line, always the same.

    The order is that of a hash of what is changed, not of its place: an
    edit elsewhere in the file leaves the choice as it is.
    """
    files: dict[str, list[Mutant]] = {}
    covered: set[tuple[str, int]] = set()
    for mutant in sorted(mutants, key=_order):
        if (mutant.file, mutant.line) not in covered:
            covered.add((mutant.file, mutant.line))
            files.setdefault(mutant.file, []).append(mutant)
    rounds = zip_longest(*(files[name] for name in sorted(files)))
    return [mutant for row in rounds for mutant in row if mutant is not None][:count]


def _order(mutant: Mutant) -> tuple[bytes, int]:
    words = "\0".join((mutant.file, mutant.operator, mutant.before, mutant.after))
    return sha256(words.encode()).digest(), mutant.line
