"""Convert TOML text to a checked, frozen struct; errors name the file and the key."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from dart_hal.core.config.quantity import Quantities, Quantity
from dart_hal.core.config.where import describe_expected, find_entry, list_choices
from dart_hal.core.errors import ConfigError

S = TypeVar("S", bound=msgspec.Struct)

_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<path>.*)`)?$", re.DOTALL)
_MISSING = re.compile(r"missing required field `(?P<name>\w+)`")
_NOT_A_TABLE = re.compile(r"Expected `object(?: \| null)?`, got `(?:int|float|array)`")

# Levels of tables and lists in a file. The files of a car have six.
MAX_DEPTH = 20
# Largest number in a file: squares and products of numbers must not overflow.
MAX_NUMBER = 1e12
# Characters of a text, except in [provenance].
MAX_TEXT_LENGTH = 1000
# Characters of a value in a message.
MAX_SHOWN_LENGTH = 200
# m, from a fine optical ring to one magnet per revolution of a large gear.
METRES_PER_EDGE_RANGE = (0.0002, 0.05)


def parse(text: str, cls: type[S], origin: str) -> S:
    """Convert ``text`` (TOML) to a ``cls``; ``origin``: name of the file in messages.

    Raises ConfigError for syntax, unknown or missing keys, wrong types,
    values out of range and numbers that are not finite.
    """
    data = decode(text, origin)
    check_schema(data, cls, origin)
    refuse_unknown(data, cls, origin)
    refuse_impossible_values(data, origin)
    try:
        return msgspec.convert(data, cls)
    except msgspec.ValidationError as error:
        raise explain_validation_error(str(error), data, origin, cls) from error


def decode(text: str, origin: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises ConfigError, also if it exhausts the parser."""
    try:
        data = msgspec.toml.decode(text)
    except (RecursionError, MemoryError) as error:
        raise _depth_error(origin, "tables or lists that the parser cannot hold") from error
    except ValueError as error:  # msgspec.DecodeError, and numbers of thousands of digits
        raise ConfigError(f"{origin} is not valid TOML: {shorten(error)}", read=origin,
                          remedy="correct the line that the message names") from error
    # Descend level by level: recursion would fail for the texts that this check excludes.
    level: list[Any] = [data]
    for _ in range(MAX_DEPTH):
        level = [inner for outer in level for inner in _list_children(outer)]
    if level:
        raise _depth_error(origin, f"more than {MAX_DEPTH} levels")
    tables: dict[str, Any] = data
    return tables


def _list_children(data: Any) -> Iterable[Any]:
    """Return the values of a table or a list."""
    if isinstance(data, Mapping):
        return data.values()
    return data if isinstance(data, list) else ()


def _depth_error(origin: str, found: str) -> ConfigError:
    return ConfigError(f"{origin}: tables or lists are nested too deeply", read=origin,
                       found=found, expected=f"at most {MAX_DEPTH} levels",
                       remedy="remove the brackets that do not belong there")


def shorten(found: object) -> str:
    """Return the text of a value for a message, at most ``MAX_SHOWN_LENGTH`` characters of it."""
    text = str(found)
    if len(text) <= MAX_SHOWN_LENGTH:
        return text
    return f"{text[:MAX_SHOWN_LENGTH]}... ({len(text)} characters)"


def check_schema(data: Mapping[str, Any], cls: type[msgspec.Struct], origin: str) -> None:
    """Raise ConfigError for a file of another kind or version, before its keys are checked."""
    default = next((f.default for f in msgspec.structs.fields(cls) if f.name == "schema"), None)
    if default is not None and data.get("schema", default) != default:
        raise ConfigError(f"{origin}: key schema names another kind of file",
                          found=shorten(repr(data["schema"])), expected=repr(default),
                          read=origin,
                          remedy="check the file's name, or convert it to this version")


def refuse_unknown(data: Any, cls: type[msgspec.Struct], origin: str, path: str = "") -> None:
    """Raise ConfigError at the first key that ``cls`` does not have.

    msgspec raises an error too, but without the most similar key.
    """
    if not isinstance(data, Mapping):
        return
    hints = get_type_hints(cls)
    for key, value in data.items():
        if key not in hints:
            raise unknown_key_error(str(key), hints, origin, path)
        _refuse_unknown_children(value, hints[key], origin, f"{path}.{key}" if path else key)


def _refuse_unknown_children(value: Any, hint: Any, origin: str, path: str) -> None:
    """Check the keys inside a value: each value of a free table, each row of a list."""
    if get_origin(hint) is dict:
        for key, inner in value.items() if isinstance(value, Mapping) else ():
            _refuse_unknown_children(inner, get_args(hint)[1], origin, f"{path}.{key}")
        return
    for struct in _list_structs(hint)[:1]:
        for row in value if isinstance(value, list) else [value]:
            refuse_unknown(row, struct, origin, path)


def unknown_key_error(key: str, known: Iterable[str], origin: str, path: str) -> ConfigError:
    """Return the error for an unknown key, with the most similar known key as remedy."""
    names = sorted(known)
    import difflib

    near = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
    remedy = f"write {near[0]} for {key}" if near else f"remove {key}"
    key = shorten(key)
    section = _describe_section(shorten(path))
    return ConfigError(f"{origin}: {section} has no key {key}", found=key,
                       expected="one of " + ", ".join(names), remedy=remedy, read=origin)


def refuse_impossible_values(data: Any, origin: str, path: str = "") -> None:
    """Raise ConfigError for NaN, infinity, too large numbers and too long texts.

    The limits are ``MAX_NUMBER`` and ``MAX_TEXT_LENGTH``; [provenance] is not checked.
    """
    if isinstance(data, float) and not math.isfinite(data):
        raise ConfigError(f"{origin}: {path} is not a finite number", found=str(data),
                          expected="a number", read=origin, remedy=f"give {path} a number")
    if isinstance(data, float | int) and abs(data) > MAX_NUMBER:
        raise ConfigError(f"{origin}: {path} is too large", found=_format_number(data),
                          expected=f"a number of at most {MAX_NUMBER:g}", read=origin,
                          remedy=f"correct {path}")
    if isinstance(data, str) and len(data) > MAX_TEXT_LENGTH:
        raise ConfigError(f"{origin}: {path} is too long", found=shorten(data),
                          expected=f"at most {MAX_TEXT_LENGTH} characters", read=origin,
                          remedy=f"correct {path}")
    if isinstance(data, Mapping):
        for key, value in data.items():
            if path or key != "provenance":
                refuse_impossible_values(value, origin, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            refuse_impossible_values(value, origin, f"{path}[{index}]")


def _format_number(number: float) -> str:
    """Return a number as text; of a whole number with too many digits only the size."""
    if isinstance(number, int) and number.bit_length() > MAX_SHOWN_LENGTH:
        return f"a whole number of {number.bit_length()} bits"
    return str(number)


def explain_validation_error(message: str, data: Mapping[str, Any], origin: str,
                             cls: type[msgspec.Struct]) -> ConfigError:
    """Return the ConfigError for a message of msgspec, with the remedy."""
    match = _AT.match(message)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    missing = _MISSING.search(what)
    path, value = find_entry(data, path, what, missing["name"] if missing else "")
    # 1. A missing standard error: either its key, or a plain number in place of a quantity.
    if missing and missing["name"].startswith("std"):
        return missing_std(origin, path, value)
    if missing:
        key = f"{path}.{missing['name']}" if path else missing["name"]
        return ConfigError(f"{origin}: key {key} is missing", found="nothing", expected=key,
                           remedy=f"add {missing['name']} to {_describe_section(path)}",
                           read=origin)
    if _NOT_A_TABLE.search(what):
        return missing_std(origin, path, value)
    # 2. A wrong type or value: suggest the most similar permitted value.
    fixed = list_choices(cls, path)
    import difflib

    near = difflib.get_close_matches(shorten(value), fixed, n=1, cutoff=0.5)
    expected = "one of " + ", ".join(fixed) if fixed else describe_expected(what)
    why = "" if expected else f": {what}"
    return ConfigError(f"{origin}: key {path} cannot be used{why}", found=shorten(repr(value)),
                       expected=expected, read=origin,
                       remedy=f"write {near[0]} for {value}" if near else f"correct {path}")


def missing_std(origin: str, key: str, found: object) -> ConfigError:
    """Return the error for a measured value without a standard error."""
    return ConfigError(
        f"{origin}: {key} has no standard error", found=shorten(repr(found)), read=origin,
        expected=f"std_rad in {key}, one for each angle" if key.endswith("map") else
        f"{key} = {{ value = ..., std = ... }}",
        remedy="measure it again with dart-hal calibrate, or enter the std you can defend")


def check_std(thing: Quantity | Quantities | None, key: str, origin: str, *,
              positive: bool = False) -> None:
    """Raise ConfigError unless std >= 0 (and, if ``positive``, the value > 0)."""
    if thing is None:
        return
    values = [thing.value] if isinstance(thing, Quantity) else list(thing.value)
    stds = [thing.std] if isinstance(thing.std, float | int) else list(thing.std)
    if len(stds) not in (1, len(values)):
        raise ConfigError(f"{origin}: {key}.std has another length than its value", read=origin,
                          found=str(len(stds)), expected=f"1 or {len(values)} numbers",
                          remedy=f"give {key}.std one number, or one for each value")
    if min(stds, default=0.0) < 0:
        raise ConfigError(f"{origin}: {key}.std is negative", found=str(min(stds)),
                          expected="a number >= 0", remedy=f"correct {key}.std", read=origin)
    if positive and min(values, default=1.0) <= 0:
        raise ConfigError(f"{origin}: {key} must be positive", found=str(min(values)),
                          expected="a number > 0", remedy=f"correct {key}", read=origin)


def require(ok: bool, origin: str, key: str, found: object, expected: str,
            remedy: str | None = None) -> None:
    """Raise ConfigError about ``key`` unless ``ok``."""
    if not ok:
        raise ConfigError(f"{origin}: {key} is out of range", found=shorten(found),
                          expected=expected, remedy=remedy or f"correct {key}", read=origin)


def _describe_section(path: str) -> str:
    return f"[{path}]" if path else "the top of the file"


def _list_structs(hint: Any) -> list[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [s for arg in get_args(hint) for s in _list_structs(arg)]
