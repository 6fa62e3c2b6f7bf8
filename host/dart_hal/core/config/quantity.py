"""A number of a particular car: its value and its standard error."""

from __future__ import annotations

import msgspec


class FileTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of every table of a file; unknown keys are errors."""


class Quantity(FileTable, frozen=True):
    """A measured value and its standard error, in the unit of its key.

    ``method``: how it was measured, in a few words.
    """

    value: float
    std: float
    method: str | None = None


class Quantities(FileTable, frozen=True):
    """Several values of one quantity (n,); ``std``: one for all, or one for each."""

    value: tuple[float, ...]
    std: float | tuple[float, ...]
    method: str | None = None
