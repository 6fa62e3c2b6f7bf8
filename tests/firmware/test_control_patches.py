"""The long tests of a firmware broken on purpose patch its text: does the text still exist?"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from firmware_rig import FIRMWARE


def list_patches(value: object) -> Iterator[tuple[str, str]]:
    """Yield (file, text) of each patch in a constant: (file, old, new), or several of them."""
    if isinstance(value, tuple):
        if len(value) == 3 and isinstance(value[0], str) and value[0].startswith("src/"):
            yield value[0], value[1]
        for one in value:
            yield from list_patches(one)


PATCHES = sorted({(path.stem, *patch) for path in Path(__file__).parent.glob("test_nano_*.py")
                  for constant in vars(importlib.import_module(path.stem)).values()
                  for patch in list_patches(constant)})


@pytest.mark.parametrize(("module", "file", "text"), PATCHES)
def test_the_firmware_has_the_text_that_a_control_replaces(module: str, file: str, text: str
                                                           ) -> None:
    assert text in (FIRMWARE / file).read_text(), f"the patch of {module}.py is out of date"


def test_the_patches_are_found() -> None:
    assert len(PATCHES) >= 6
