"""Notes about files: each in full for machines, one line per kind for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileNote:
    """Something about one file.

    kind: the sentence without what differs between files; notes of one kind
    are grouped. text: the whole sentence, empty: the kind. rows: how many it
    concerns, 0: the whole file. value: a figure of this file in
    ``value_unit``, or None.
    """

    file: str
    kind: str
    text: str = ""
    rows: int = 0
    value: float | None = None
    value_unit: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.text or self.kind}"


def grouped(notes: Sequence[FileNote]) -> tuple[str, ...]:
    """One line per kind, in the order in which the kinds first occur."""
    kinds: dict[str, list[FileNote]] = {}
    for note in notes:
        kinds.setdefault(note.kind, []).append(note)
    return tuple(_line(kind, same) for kind, same in kinds.items())


def _line(kind: str, notes: Sequence[FileNote]) -> str:
    files = list(dict.fromkeys(n.file for n in notes))
    where = f"in {len(files)} files" if len(files) > 1 else f"in {files[0]}"
    rows = sum(n.rows for n in notes)
    values = [n.value for n in notes if n.value is not None]
    figures = ""
    if values:
        low, high = f"{min(values):.2f}", f"{max(values):.2f}"
        span = low if low == high else f"{low} to {high}"
        figures = f" ({span} {notes[0].value_unit})"
    return f"{kind}: {f'{rows} rows ' if rows else ''}{where}{figures}"
