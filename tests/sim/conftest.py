"""Simulated cars for the tests of this room."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from hypothesis import settings

from dart_hal.errors import EmulatorMissing

collect_ignore_glob = [] if importlib.util.find_spec("gymnasium") else ["test_gym_*.py"]

settings.register_profile("virtual-time", deadline=None)
settings.load_profile("virtual-time")       # a busy machine is no fault of the code

_SPEC = importlib.util.spec_from_file_location("simulated_car",
                                               Path(__file__).with_name("simulated_car.py"))
_MODULE = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_MODULE)


@pytest.fixture
def raw_car():
    """``raw_car(url, slice_s=0.01)``: a simulated car driven by pulses; closed at the end."""
    cars = []

    def make(url="sim://?nano=mock", slice_s=0.01):
        try:
            cars.append(_MODULE.RawCar(url, slice_s))
        except EmulatorMissing as missing:
            pytest.skip(f"no emulator: {missing.what}")
        return cars[-1]

    yield make
    for car in cars:
        car.backend.close()
