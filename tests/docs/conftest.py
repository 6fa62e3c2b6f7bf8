"""Modules of these tests, and those of other folders that they use."""

from __future__ import annotations

import sys
from pathlib import Path

TESTS_FOLDER = Path(__file__).parents[1]
for folder in (TESTS_FOLDER / "hardware", Path(__file__).parent):
    sys.path.insert(0, str(folder))
