"""The page of the architecture shows every package and folder, and none that does not exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from handbook import DOCS, ROOT

ARCHITECTURE_PAGE = DOCS / "explanation" / "architecture.md"
HOST = ROOT / "host"
SOURCE_SUFFIXES = {".py", ".cpp", ".c", ".h", ".hex", ".sh", ".toml", ".md"}
LEAF = ("examples", "benchmarks", "studies", "tests", "docs", "cars")
"""Drawn as one; every other top folder is drawn by its folders."""
MADE = {"hardware/stl", "hardware/dxf", "hardware/pictures"}  # by hardware/cad, stated on its line


def drawing(title: str) -> list[str]:
    """Lines of the first drawing below a heading."""
    below = ARCHITECTURE_PAGE.read_text(encoding="utf-8").split(f"# {title}\n", 1)[1]
    match = re.search(r"```text\n(.*?)```", below, re.DOTALL)
    assert match
    return match[1].splitlines()


def names_in(lines: list[str]) -> set[str]:
    """Names in the first column, which ends where two blanks follow each other."""
    return {word for line in lines if line[:1].isalpha()
            for word in re.split(r"\s{2,}", line)[0].split() if word not in "|:"}


def holds_sources(folder: Path) -> bool:
    return any(p.suffix in SOURCE_SUFFIXES for p in folder.rglob("*") if "build" not in p.parts)


@pytest.mark.parametrize("package", ["dart_hal: what runs on a car",
                                     "dart_lab: what runs on a workstation"])
def test_every_package_is_shown(package):
    folder = HOST / package.partition(":")[0]
    existing = {p.name for p in folder.iterdir()
                if p.is_dir() and p.name not in ("__pycache__", "prebuilt", "cars")
                and any(p.glob("*.py"))}
    existing |= {p.stem for p in folder.glob("*.py") if not p.stem.startswith("_")}
    assert names_in(drawing(package)) == existing


@pytest.mark.slow
def test_every_folder_of_the_tree_is_shown():
    drawn = {line.split()[0].rstrip("/") for line in drawing("The whole tree")}
    existing = set()
    for top in sorted(p for p in ROOT.iterdir() if p.is_dir() and holds_sources(p)):
        if top.name in LEAF:
            existing.add(top.name)
        elif top.name in ("host", "firmware", "hardware"):
            existing |= {f"{top.name}/{p.name}" for p in top.iterdir()
                         if p.is_dir() and holds_sources(p)}
    existing -= MADE
    existing -= {"firmware/src", "firmware/build"}
    existing |= {f"firmware/src/{p.name}" for p in (ROOT / "firmware" / "src").iterdir()
                 if p.is_dir()}
    assert drawn == existing


def test_a_package_that_is_not_shown_is_found():
    assert names_in(["car | links   the facade", "   more words"]) == {"car", "links"}
