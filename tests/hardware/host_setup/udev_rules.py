"""The part of the language of udev rules that our rules use: read, checked, applied.

Keys and operators after udev(7); matches are compared literally, without its
patterns, which our rules do not use.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

MATCH = {"ACTION", "SUBSYSTEM", "DRIVER", "KERNEL", "ATTR", "ATTRS", "SUBSYSTEMS", "DRIVERS", "ENV"}
ASSIGN = {"SYMLINK": "+=", "TAG": "+=", "GROUP": "=", "MODE": "=", "ENV": "=", "ATTR": "=",
          "GOTO": "=", "LABEL": "="}
TOKEN = re.compile(r'\s*([A-Z]+)(?:\{([A-Za-z_]+)\})?\s*(==|!=|\+=|:=|=)\s*"([^"]*)"\s*(?:,|$)')


class BadRule(ValueError):
    """A line that udev would not take as it was meant."""


@dataclass(frozen=True)
class Word:
    """``KEY{attribute} operator "value"``."""

    key: str
    attribute: str
    operator: str
    value: str

    @property
    def matches(self) -> bool:
        """A condition, not an order."""
        return self.operator in ("==", "!=")


@dataclass
class UdevDevice:
    """What udev sees: the device's own facts, and attributes of those above it."""

    subsystem: str
    attrs: dict[str, str] = field(default_factory=dict)
    driver: str = ""
    action: str = "add"


def parse(text: str) -> list[list[Word]]:
    """One list of words per rule. Raises BadRule with the line."""
    rules = [_rule(line) for line in text.splitlines()
             if line.strip() and not line.lstrip().startswith("#")]
    words = [w for rule in rules for w in rule]
    labels = {w.value for w in words if w.key == "LABEL"}
    for word in words:
        if word.key == "GOTO" and word.value not in labels:
            raise BadRule(f"GOTO {word.value} has no LABEL")
    return rules


def _rule(line: str) -> list[Word]:
    words = []
    at = 0
    while at < len(line.rstrip()):
        found = TOKEN.match(line, at)
        if found is None:
            raise BadRule(f"cannot read {line[at:]!r}")
        key, attribute, operator, value = found.groups(default="")
        word = Word(key, attribute, operator, value)
        if word.matches and key not in MATCH:
            raise BadRule(f"{key} cannot be compared: {line}")
        if not word.matches and ASSIGN.get(key) != operator:
            raise BadRule(f"{key} cannot be set with {operator}: {line}")
        if (key in ("ATTR", "ATTRS", "ENV")) != bool(attribute):
            raise BadRule(f"{key} with or without its braces: {line}")
        words.append(word)
        at = found.end()
    return words


def apply(rules: list[list[Word]], device: UdevDevice) -> dict[str, str]:
    """What the rules order for a device: {"SYMLINK": ..., "ATTR{latency_timer}": ...}."""
    given: dict[str, str] = {}
    skip = ""
    for rule in rules:
        if skip:
            if not any(w.key == "LABEL" and w.value == skip for w in rule):
                continue
            skip = ""
        if not all(_holds(w, device) for w in rule if w.matches):
            continue
        for word in (w for w in rule if not w.matches):
            name = f"{word.key}{{{word.attribute}}}" if word.attribute else word.key
            added = [given[name]] if word.operator == "+=" and name in given else []
            given[name] = " ".join([*added, word.value])
            skip = word.value if word.key == "GOTO" else skip
    return {k: v for k, v in given.items() if k not in ("GOTO", "LABEL")}


def _holds(word: Word, device: UdevDevice) -> bool:
    found = {"ACTION": device.action, "SUBSYSTEM": device.subsystem, "DRIVER": device.driver,
             "ATTRS": device.attrs.get(word.attribute, "")}[word.key]
    return (found == word.value) == (word.operator == "==")
