"""The first page for contributors names commands, files and folders that exist."""

from __future__ import annotations

import re

import handbook
import pytest
from handbook import DOCS, ROOT
from test_guide import unknown_command

CONTRIBUTING_PAGE = DOCS / "contributing" / "index.md"
INLINE_CODE = re.compile(r"`([^`\n]+)`")


def commands(text: str) -> list[str]:
    """Commands in blocks and in the running text; NAME is a folder of tests."""
    shown = [c for b in handbook.blocks(text) if b.kind == "sh" for c in b.commands()
             if not c.startswith(("git ", "cd "))]
    return shown + [c.replace("tests/NAME", "tests/wire").removeprefix(".venv/bin/")
                    for c in INLINE_CODE.findall(text) if c.startswith((".venv/bin/", "make "))]


def missing_paths(text: str) -> list[str]:
    """Paths of the tree in the running text that do not exist."""
    tops = r"(?:host|tests|studies|firmware|docs|cars)/"
    named = [c for c in INLINE_CODE.findall(text) if re.match(tops, c)]
    assert len(named) > 15
    return [name for name in named if not (ROOT / name).exists()]


def test_every_command_exists():
    found = [c for c in commands(CONTRIBUTING_PAGE.read_text(encoding="utf-8"))
             if c != "ruff check ."]
    assert len(found) > 10
    assert [f"{c}: {why}" for c in found if (why := unknown_command(c))] == []


def test_every_path_exists():
    text = CONTRIBUTING_PAGE.read_text(encoding="utf-8")
    assert missing_paths(text) == []
    assert missing_paths(text.replace("host/dart_lab/sim/", "host/dart_lab/simulation/"))


@pytest.mark.parametrize("command", ["make tests", "dart-hal wires --write"])
def test_a_command_that_does_not_exist_is_detected(command):
    """The negative control."""
    assert unknown_command(command)


def test_set_up_is_three_commands():
    first = handbook.blocks(CONTRIBUTING_PAGE.read_text(encoding="utf-8"))[0]
    assert len(first.text.splitlines()) == 3
