"""Copies of the wiring's sources, to break one thing in."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.common import WIRING


@pytest.fixture
def copy(tmp_path: Path) -> Callable[[str, str, str], Path]:
    """``copy(file, old, new)``: a copy of the sources with one thing broken."""
    folder = tmp_path / "wiring"
    shutil.copytree(WIRING, folder, ignore=shutil.ignore_patterns("__*"))

    def broken(file: str, old: str, new: str) -> Path:
        path = folder / file
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        return folder

    return broken
