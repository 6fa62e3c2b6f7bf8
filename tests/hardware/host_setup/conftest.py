"""Makes the helper modules of this folder importable under importmode=importlib."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def box(tmp_path):
    """A Jetson Nano made of fakes, fresh from its image."""
    from setup_box import Box

    return Box(tmp_path)
