"""The standard drive of this room, and the base model's part in it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from effect_drive import drive

from dart_hal.vehicle import PAPER


@pytest.fixture(scope="session")
def base_drive():
    return drive(PAPER)
