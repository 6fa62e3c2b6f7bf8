"""What all tests share: on a build server a missing emulator is a failure, not a skip."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

IN_CI = os.environ.get("CI", "").lower() in ("1", "true", "yes")

if IN_CI:
    os.environ.setdefault("DART_HAL_REQUIRE_EMULATOR", "1")


settings.register_profile("dart", deadline=None)  # how long an example takes is the machine's
settings.load_profile("dart")

HOME = Path(__file__).resolve().parents[1]
sys.path.append(str(HOME / "tests" / "wire"))  # wire_samples: traffic and damage for every room


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The full set of DART recordings; a test that needs it is skipped where it is absent."""
    places = [os.environ.get("DART_DATA"), HOME.parent / "shared" / "data" / "dart"]
    for place in places:
        if place and Path(place).is_dir():
            return Path(place)
    pytest.skip(f"full recordings absent: $DART_DATA is {places[0]!r} and {places[1]} is no folder")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if IN_CI and report.skipped and item.get_closest_marker("emulator"):
        report.outcome = "failed"
        report.longrepr = f"not skipped on a build server: {report.longrepr}"
    return report


@pytest.fixture(autouse=True)
def no_car_of_the_user(monkeypatch, tmp_path_factory):
    """Neither the environment nor the home folder of the developer decides a test."""
    monkeypatch.delenv("DART_HAL_URL", raising=False)
    monkeypatch.delenv("DART_CARS", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path_factory.getbasetemp() / "share"))
