"""Simulated cars for the tests of this room."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from dart_hal.core.errors import EmulatorMissing

collect_ignore_glob = [] if importlib.util.find_spec("gymnasium") else ["test_gym_*.py"]

settings.register_profile("virtual-time", deadline=None)
settings.load_profile("virtual-time")       # a busy machine is no fault of the code


def _tool(name):
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_MODULE, _PROBE = _tool("simulated_car"), _tool("pins_probe")


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


@pytest.fixture(scope="session")
def driven():
    """``driven(url, plan)``: what a host reads of a car that drives a plan; see pins_probe.

    The same drive is driven once.
    """
    kept = {}

    def drive(url, plan):
        if (url, plan) not in kept:
            try:
                record = _PROBE.drive(_MODULE.RawCar, url, plan)
            except EmulatorMissing as missing:
                pytest.skip(f"no emulator: {missing.what}")
            record.car.backend.close()
            kept[url, plan] = record
        return kept[url, plan]

    return drive
