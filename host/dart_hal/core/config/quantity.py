"""A number of a particular car: its value and its standard error."""

from __future__ import annotations

import msgspec


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of every table: strict about its keys."""


class Quantity(Table, frozen=True):
    """A measured value with one standard error, in the unit its key names.

    ``method`` says in a few words how it was obtained.
    """

    value: float
    std: float
    method: str | None = None


class Quantities(Table, frozen=True):
    """Several values that belong together; ``std`` one for all, or one each."""

    value: tuple[float, ...]
    std: float | tuple[float, ...]
    method: str | None = None
