"""Reads `parameters.toml`: every dimension with unit, bounds and source.

`load()` gives groups of plain numbers (`p.rings.tip`, mm). Anything impossible raises
`ParameterError`, which names each parameter at fault, its value and its bounds.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FILE = Path(__file__).with_name("parameters.toml")
KEYS = ("value", "unit", "min", "max", "source", "comment")
UNITS = ("mm", "deg", "1", "g", "g/cm3")
SOURCES = ("measured", "data sheet", "upstream drawing", "photo", "assumed")


class ParameterError(ValueError):
    """One or more impossible parameters; the message lists all of them."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("impossible parameters, nothing was written:\n  "
                         + "\n  ".join(problems)
                         + "\ncorrect hardware/cad/parameters.toml and run the command again")


PAIRS = ("jetson.x", "jetson.y", "board_posts.x", "board_posts.y", "base_holes.antenna_y",
         "base_holes.clear_front_y", "base_holes.mount_y", "base_holes.cable_x",
         "base_holes.cable_y", "base_holes.adapter_x", "base_holes.adapter_y",
         "base_windows.nano_x", "base_windows.nano_y", "base_windows.lead_x",
         "base_windows.lead_y", "base_windows.lead_angle", "upper.antenna_y", "back.hole_v",
         "back.notch_u")
COUNTS = dict.fromkeys(PAIRS, 2) | dict.fromkeys(
    ("base_windows.fan", "base_windows.six_wire", "back.window"), 4)
"""How many numbers a list has; all other parameters but the outlines are one number."""
OUTLINES = ("upper.outline_left", "upper.outline_right")


class Group(SimpleNamespace):
    """Dimensions as attributes; one that the file does not hold is named by a ParameterError."""

    group_: str = ""

    def __getattr__(self, key: str) -> Any:
        if key.startswith("_"):
            raise AttributeError(key)
        name = f"{self.group_}.{key}" if self.group_ else f"[{key}]"
        raise ParameterError([f"{name}: missing; expected an entry as in hardware/cad/"
                              "parameters.toml of the repository (git diff shows what went)"])


class Parameters(Group):
    """Groups of dimensions as attributes; `raw` keeps units, bounds and sources."""

    raw: dict[str, dict[str, dict[str, Any]]]


def values(entry: dict[str, Any]) -> list[float]:
    """The numbers of one entry, a single one as a list of one."""
    value = entry["value"]
    return list(value) if isinstance(value, list) else [value]


def problems_of(name: str, entry: object) -> list[str]:
    """What is wrong with one entry by itself; `name` is "group.key"."""
    if not isinstance(entry, dict):
        return [f"{name} = {entry!r}: expected a table with {', '.join(KEYS)}"]
    missing = [k for k in KEYS if k not in entry]
    extra = [k for k in entry if k not in KEYS]
    if missing or extra:
        return [f"{name}: missing {missing}, unknown {extra}; expected {', '.join(KEYS)}"]
    found = []
    numbers = values(entry)
    if not numbers or any(isinstance(v, bool) or not isinstance(v, int | float) for v in numbers):
        return [f"{name} = {entry['value']!r}: expected a number or a list of numbers"]
    found += _miscounted(name, entry["value"], len(numbers))
    for number in numbers:
        if not entry["min"] <= number <= entry["max"]:  # also catches nan
            found.append(f"{name} = {number:g} {entry['unit']}: outside its bounds "
                         f"{entry['min']:g} to {entry['max']:g} {entry['unit']}")
    if entry["unit"] not in UNITS:
        found.append(f"{name}: unit {entry['unit']!r}, expected one of {', '.join(UNITS)}")
    if entry["source"] not in SOURCES:
        found.append(f"{name}: source {entry['source']!r}, expected one of {', '.join(SOURCES)}")
    if entry["unit"] == "1" and isinstance(entry["min"], int) and isinstance(entry["max"], int) \
            and any(v != int(v) for v in numbers) and entry["min"] >= 1:
        found.append(f"{name} = {entry['value']!r}: expected a whole number")
    return found


def _miscounted(name: str, value: object, count: int) -> list[str]:
    if name in OUTLINES:
        good, expected = count >= 6 and count % 2 == 0, "x and y of at least three points"
    else:
        wanted = COUNTS.get(name, 1)
        good = count == wanted and isinstance(value, list) == (wanted > 1)
        expected = f"a list of {wanted} numbers" if wanted > 1 else "one number"
    return [] if good else [f"{name} = {value!r}: expected {expected}"]


def parse(raw: dict[str, Any]) -> Parameters:
    """Parameters of a parsed file. Raises ParameterError for entries outside their bounds."""
    problems = []
    for group, entries in raw.items():
        if not isinstance(entries, dict):
            problems.append(f"{group}: expected a table [{group}]")
            continue
        for key, entry in entries.items():
            problems += problems_of(f"{group}.{key}", entry)
    if problems:
        raise ParameterError(problems)
    groups = {group: Group(group_=group, **{k: _plain(e["value"]) for k, e in entries.items()})
              for group, entries in raw.items()}
    return Parameters(raw=raw, **groups)


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def read(path: Path = FILE) -> Parameters:
    """Parameters of a file, each within its own bounds; see `checks.load` for the relations."""
    try:
        with path.open("rb") as file:
            raw = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise ParameterError([f"{path.name}: cannot be read: {error}"]) from error
    return parse(raw)
