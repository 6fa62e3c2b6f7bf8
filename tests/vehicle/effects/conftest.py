"""The standard drive of this room, and the base model's part in it."""

from __future__ import annotations

import pytest

from dart_hal.vehicle import PAPER
from tests.vehicle.effects.effect_drive import drive


@pytest.fixture(scope="session")
def base_drive():
    return drive(PAPER)
