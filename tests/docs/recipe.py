"""A recipe of the page as data, and a copy of the tree in which it is followed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import handbook
from handbook import DOCS, ROOT, Block

RECIPES_PAGE = DOCS / "contributing" / "recipes.md"
COPIED = ("host", "tests", "studies", "firmware", "docs/reference", "docs/contributing")
"""Folders that recipes change, or that the commands compare with."""
LINKED = ("cars", "examples", "hardware", "benchmarks", "pyproject.toml")
RECIPE_TIMEOUT_S = 600.0
"""s for one command, on a machine that does something else as well."""
OUTPUT = 4000
"""Characters of the output that a failure shows."""


class RecipeFailed(AssertionError):
    """A change does not fit the tree, or a command failed."""


def recipe(heading: str) -> list[Block]:
    """Return the blocks below a heading of the page, up to the next one."""
    _, found, below = RECIPES_PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    assert found, f"no recipe {heading!r}"
    return handbook.blocks(below.partition("\n## ")[0])


def headings() -> list[str]:
    return re.findall(r"^## (.+)$", RECIPES_PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def edited_file(block: Block) -> str:
    """Return the path that a block of changes names, or nothing."""
    return block.mark.removeprefix("edit: ") if block.mark.startswith("edit: ") else ""


def hunks(changes: str) -> Iterator[tuple[str, str]]:
    """Return (old, new) lines of each hunk of a block of changes."""
    for part in re.split(r"^@@\n", changes, flags=re.MULTILINE):
        lines = part.splitlines()
        wrong = [line for line in lines if line and line[0] not in " +-"]
        if wrong:
            raise RecipeFailed(f"a line without ' ', '+' or '-' in front: {wrong[0]}")
        old = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("+"))
        new = "".join(f"{line[1:]}\n" for line in lines if not line.startswith("-"))
        yield old, new


def apply_changes(text: str, changes: str, where: str = "") -> str:
    """Apply a block of changes. Raises RecipeFailed unless each place is there exactly once."""
    for old, new in hunks(changes):
        places = [m.start() for m in re.finditer(f"^{re.escape(old)}", text, re.MULTILINE)]
        if not old or len(places) != 1:
            raise RecipeFailed(f"{where}: {len(places)} places, 1 expected, for\n{old}")
        text = text[:places[0]] + new + text[places[0] + len(old):]
    return text


class Checkout:
    """A copy of the tree in a folder of its own; its ``.venv`` is that of the tests."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        skip = shutil.ignore_patterns("__pycache__", "build", "*.pyc")
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=skip)
        for name in LINKED:
            (folder / name).symlink_to(ROOT / name)
        (folder / ".venv").symlink_to(sys.prefix)

    def follow(self, heading: str, skip: Callable[[Block], bool] = lambda block: False) -> None:
        """Carry out a recipe, except the blocks to ``skip``. Raises RecipeFailed."""
        for block in recipe(heading):
            if skip(block):
                continue
            if block.file:
                path = self.folder / block.file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.text, encoding="utf-8")
            elif name := edited_file(block):
                path = self.folder / name
                path.write_text(apply_changes(path.read_text(encoding="utf-8"), block.text, name),
                                encoding="utf-8")
            elif block.kind == "sh" and block.runs:
                for command in block.commands():
                    self.run(command)

    def run(self, command: str) -> str:
        """Run a command of the page in the copy; its output. Raises RecipeFailed."""
        env = {k: v for k, v in os.environ.items() if not k.startswith(("DART_", "PYTEST_"))}
        env |= {"PYTHONPATH": str(self.folder / "host"), "PYTHONDONTWRITEBYTECODE": "1",
                "HOME": str(self.folder), "XDG_DATA_HOME": str(self.folder / "data")}
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], cwd=self.folder, env=env,
                              capture_output=True, text=True, check=False, timeout=RECIPE_TIMEOUT_S)
        printed = done.stdout + done.stderr
        if done.returncode:
            raise RecipeFailed(f"{command}\n{printed[-OUTPUT:]}")
        return printed
