"""Find the entry of a file that a message of msgspec refers to, and its permitted values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

PYTHON_TYPES: dict[str, type] = {"str": str, "bool": bool, "int": int, "float": float,
                                 "array": list, "object": dict}
TYPE_DESCRIPTIONS = {"float": "a number", "int": "a whole number", "str": "text in quotes",
                     "bool": "true or false", "array": "a list", "object": "a table"}
QUANTITY_DESCRIPTION = "a number, or { value = ..., std = ... }"
_GOT = re.compile(r"got `(\w+)`")


def find_entry(data: Any, path: str, what: str, lacks: str = "") -> tuple[str, Any]:
    """Return (key, value) of the entry that a message ``what`` at ``path`` refers to.

    lacks: the key that is missing there. msgspec writes ``[...]`` for a key of a free table or a
    row of a list: the result is the first entry to which the message applies.
    """
    got = _GOT.search(what)
    kind = PYTHON_TYPES.get(got[1]) if got else None

    def fits(value: Any) -> bool:
        if lacks:
            return isinstance(value, Mapping) and lacks not in value
        return kind is None or type(value) is kind

    parts = re.findall(r"\.\.\.|[^.\[\]]+", path)
    return next(_entries(data, parts, fits, ""), (path, None))


def _entries(data: Any, parts: list[str], fits: Callable[[Any], bool],
             path: str) -> Iterator[tuple[str, Any]]:
    """Iterate over the entries of a path that fit; ``...`` is any key or row."""
    if not parts:
        if fits(data):
            yield path, data
        return
    first, *rest = parts
    if isinstance(data, Mapping):
        for key in data if first == "..." else [first]:
            yield from _entries(data.get(key), rest, fits, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list):
        for i in range(len(data)):
            if first in ("...", str(i)):
                yield from _entries(data[i], rest, fits, f"{path}[{i}]")


def describe_expected(what: str) -> str:
    """Describe the types of "Expected `a | b`, got ..." in words; "" for another message."""
    named = re.match(r"Expected `([^`]+)`", what)
    if not named:
        return ""
    kinds = [k for k in named[1].split(" | ") if k != "null"]
    if kinds == ["float", "object"]:
        return QUANTITY_DESCRIPTION
    return " or ".join(TYPE_DESCRIPTIONS.get(k, k) for k in kinds)


def list_choices(cls: type[msgspec.Struct], path: str) -> tuple[str, ...]:
    """Return the permitted values of a key with a fixed set of them; () for another key."""
    # Follow the path through the type hints; an optional table is a union that contains it.
    hint: Any = cls
    for part in re.findall(r"[^.\[\]]+", path):
        tables = [h for h in (hint, *get_args(hint)) if hasattr(h, "__struct_fields__")]
        hint = get_type_hints(tables[0]).get(part) if tables else None
    return tuple(map(str, get_args(hint))) if get_origin(hint) is Literal else ()
