"""The build guide as data: its steps with parts, tools, skill and time; its commands.

A step is a heading "S03: ..." followed by a list of exactly four lines:

    - Parts: 1 x `striped_ring`, `glue`      a count = taken out of the bag in this step
    - Tools: `brush`                          ids of tools.csv, or none
    - Skill: glue
    - Time: 40 min
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

PAGES = Path(__file__).resolve().parents[1] / "docs" / "build_guide"
SKILLS = ("none", "screws", "glue", "solder")
STEP = re.compile(r"^#{2,3} ([A-Z]\d\d): (.+)$")
FIELDS = ("Parts", "Tools", "Skill", "Time")
PART = re.compile(r"(?:(\d+) x )?`(\w+)`")
FENCE = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


class GuideError(ValueError):
    """A step that cannot be read: page, step, what was expected."""


@dataclass(frozen=True, slots=True)
class Step:
    """``parts``: id -> count, 0 = named without one. ``minutes`` of work, hands on."""

    id: str
    title: str
    page: str
    option: bool
    parts: dict[str, int]
    tools: tuple[str, ...]
    skill: str
    minutes: int


def pages(folder: Path = PAGES) -> dict[str, str]:
    """Name -> text of every page, in reading order."""
    return {p.name: p.read_text(encoding="utf-8") for p in sorted(folder.glob("[0-9]*.md"))}


def steps(folder: Path = PAGES) -> list[Step]:
    """Every step in reading order. Raises GuideError."""
    found = []
    for name, text in pages(folder).items():
        lines = text.splitlines()
        for n, line in enumerate(lines):
            if match := STEP.match(line):
                found.append(_step(match[1], match[2], name, line.startswith("###"),
                                   lines[n + 1:n + 6]))
    return found


def _step(ident: str, title: str, page: str, option: bool, below: list[str]) -> Step:
    where = f"{page}, {ident}"
    values = {}
    for field, line in zip(FIELDS, [x for x in below if x.strip()], strict=False):
        if not line.startswith(f"- {field}: "):
            raise GuideError(f"{where}: '- {field}: ...' expected, found {line!r}")
        values[field] = line.split(": ", 1)[1].strip()
    if len(values) != len(FIELDS):
        raise GuideError(f"{where}: {', '.join(FIELDS)} expected, found {', '.join(values)}")
    time = re.fullmatch(r"(\d+) min", values["Time"])
    if time is None or values["Skill"] not in SKILLS:
        raise GuideError(f"{where}: 'Time: N min' and a skill of {', '.join(SKILLS)} expected, "
                         f"found {values['Time']!r}, {values['Skill']!r}")
    parts: dict[str, int] = {}
    for count, part in PART.findall(values["Parts"]):
        parts[part] = parts.get(part, 0) + int(count or 0)
    tools = () if values["Tools"] == "none" else tuple(re.findall(r"`(\w+)`", values["Tools"]))
    return Step(ident, title, page, option, parts, tools, values["Skill"], int(time[1]))


def commands(text: str) -> list[str]:
    """Shell lines of a page: its sh blocks, and what stands in backquotes and is a command."""
    lines = [x.strip() for block in FENCE.findall(text) for x in block.splitlines()]
    inline = re.findall(r"(?<!`)`((?:dart-hal|python|make|sudo|sh|i2cdetect) [^`]+)`(?!`)", text)
    out = []
    for line in lines + inline:
        out += [x.strip() for x in re.split(r"&&|\s;\s|\|", line.split(" #")[0])]
    return [x for x in out if x and not x.startswith("#")]
