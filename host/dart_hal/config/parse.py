"""TOML text to a checked, frozen struct; every refusal names file and key."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from dart_hal.config.quantity import Quantities, Quantity
from dart_hal.config.where import choices, locate, wanted
from dart_hal.errors import ConfigError

S = TypeVar("S", bound=msgspec.Struct)

_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<path>.*)`)?$", re.DOTALL)
_MISSING = re.compile(r"missing required field `(?P<name>\w+)`")
_NOT_A_TABLE = re.compile(r"Expected `object(?: \| null)?`, got `(?:int|float|array)`")

PER_EDGE = (0.0002, 0.05)
"""m: from a fine optical ring to one magnet per turn of a large gear."""


def parse(text: str, cls: type[S], origin: str) -> S:
    """Read ``text`` (TOML) as a ``cls``; ``origin`` is the file's name.

    Raises ConfigError for syntax, unknown or missing keys, wrong types,
    values out of range and numbers that are not finite.
    """
    try:
        data = msgspec.toml.decode(text)
    except msgspec.DecodeError as error:
        raise ConfigError(f"{origin} is not valid TOML: {error}", read=origin,
                          remedy="correct the line that the message names") from error
    check_schema(data, cls, origin)
    refuse_unknown(data, cls, origin)
    refuse_not_finite(data, origin)
    try:
        return msgspec.convert(data, cls)
    except msgspec.ValidationError as error:
        raise explain(str(error), data, origin, cls) from error


def check_schema(data: Mapping[str, Any], cls: type[msgspec.Struct], origin: str) -> None:
    """A file of another kind or version is refused before its keys confuse."""
    default = next((f.default for f in msgspec.structs.fields(cls) if f.name == "schema"), None)
    if default is not None and data.get("schema", default) != default:
        raise ConfigError(f"{origin}: key schema names another kind of file",
                          found=repr(data["schema"]), expected=repr(default), read=origin,
                          remedy="check the file's name, or convert it to this version")


def refuse_unknown(data: Any, cls: type[msgspec.Struct], origin: str, path: str = "") -> None:
    """Raise ConfigError at the first key that ``cls`` does not have.

    msgspec refuses it too; this walk can name the nearest key that exists.
    """
    if not isinstance(data, Mapping):
        return
    hints = get_type_hints(cls)
    for key, value in data.items():
        if key not in hints:
            raise unknown_key(str(key), hints, origin, path)
        _refuse_inside(value, hints[key], origin, f"{path}.{key}" if path else key)


def _refuse_inside(value: Any, hint: Any, origin: str, path: str) -> None:
    """Walk into a value: a free table by its values, a list by its rows."""
    if get_origin(hint) is dict:
        for key, inner in value.items() if isinstance(value, Mapping) else ():
            _refuse_inside(inner, get_args(hint)[1], origin, f"{path}.{key}")
        return
    for struct in _structs_in(hint)[:1]:
        for row in value if isinstance(value, list) else [value]:
            refuse_unknown(row, struct, origin, path)


def unknown_key(key: str, known: Iterable[str], origin: str, path: str) -> ConfigError:
    """The refusal of a misspelt key, with the nearest one that exists."""
    names = sorted(known)
    near = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
    remedy = f"write {near[0]} for {key}" if near else f"remove {key}"
    return ConfigError(f"{origin}: {_section(path)} has no key {key}", found=key,
                       expected="one of " + ", ".join(names), remedy=remedy, read=origin)


def refuse_not_finite(data: Any, origin: str, path: str = "") -> None:
    """TOML can spell nan and inf; no number of a car is either."""
    if isinstance(data, float) and not math.isfinite(data):
        raise ConfigError(f"{origin}: {path} is not a finite number", found=str(data),
                          expected="a number", read=origin, remedy=f"give {path} a number")
    if isinstance(data, Mapping):
        for key, value in data.items():
            refuse_not_finite(value, origin, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            refuse_not_finite(value, origin, f"{path}[{index}]")


def explain(message: str, data: Mapping[str, Any], origin: str,
            cls: type[msgspec.Struct]) -> ConfigError:
    """msgspec's sentence as a refusal that names the remedy."""
    match = _AT.match(message)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    missing = _MISSING.search(what)
    path, value = locate(data, path, what, missing["name"] if missing else "")
    if missing and missing["name"].startswith("std"):
        return no_std(origin, path, value)
    if missing:
        key = f"{path}.{missing['name']}" if path else missing["name"]
        return ConfigError(f"{origin}: key {key} is missing", found="nothing", expected=key,
                           remedy=f"add {missing['name']} to {_section(path)}", read=origin)
    if _NOT_A_TABLE.search(what):
        return no_std(origin, path, value)
    fixed = choices(cls, path)
    near = difflib.get_close_matches(str(value), fixed, n=1, cutoff=0.5)
    expected = "one of " + ", ".join(fixed) if fixed else wanted(what)
    why = "" if expected else f": {what}"
    return ConfigError(f"{origin}: key {path} cannot be used{why}", found=repr(value),
                       expected=expected, read=origin,
                       remedy=f"write {near[0]} for {value}" if near else f"correct {path}")


def no_std(origin: str, key: str, found: object) -> ConfigError:
    """A measured value whose standard error is missing."""
    return ConfigError(
        f"{origin}: {key} has no standard error", found=repr(found), read=origin,
        expected=f"std_rad in {key}, one for each angle" if key.endswith("map") else
        f"{key} = {{ value = ..., std = ... }}",
        remedy="measure it again with dart-hal calibrate, or enter the std you can defend")


def check_std(thing: Quantity | Quantities | None, key: str, origin: str, *,
              positive: bool = False) -> None:
    """Raise ConfigError unless std >= 0 (and the value positive, where asked)."""
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
        raise ConfigError(f"{origin}: {key} is out of range", found=f"{found}",
                          expected=expected, remedy=remedy or f"correct {key}", read=origin)


def _section(path: str) -> str:
    return f"[{path}]" if path else "the top of the file"


def _structs_in(hint: Any) -> list[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return [hint]
    return [s for arg in get_args(hint) for s in _structs_in(arg)]
