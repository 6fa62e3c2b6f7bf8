"""What all tests share: on a build server a missing emulator is a failure, not a skip."""

from __future__ import annotations

import gc
import itertools
import os
import sys
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy comes: threads of a linear algebra that wait for each other burn the CPU time that is
# watched here, and two processes of tests fill two cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

IN_CI = os.environ.get("CI", "").lower() in ("1", "true", "yes")

if IN_CI:
    os.environ.setdefault("DART_HAL_REQUIRE_EMULATOR", "1")


# How long an example takes is the machine's: no deadline.
settings.register_profile("dev", deadline=None, max_examples=10)
settings.register_profile("ci", deadline=None, max_examples=200)
settings.load_profile("dev")

sys.path.append(str(Path(__file__).parent))
import cpu_time  # noqa: E402

HOME = Path(__file__).resolve().parents[1]

TESTS = itertools.count()
SHORT_NEUTRAL = 0.1
"""s of neutral that an ESC needs where it was armed before: five pulses."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cpu-limit", type=float, default=0.0, metavar="SECONDS",
                     help="fail a test that takes more CPU time and has no mark for it")
    parser.addoption("--cpu-list", type=Path, metavar="FILE", help="write each test's CPU seconds")


def pytest_configure(config: pytest.Config) -> None:
    keep = None if hasattr(config, "workerinput") else config.getoption("--cpu-list")
    config.pluginmanager.register(
        cpu_time.Watch(config.getoption("--cpu-limit"), keep), "cpu-time")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """What is collected stays: nothing looks for garbage among it, which took a tenth of a run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What a mark ``few`` does not name is for ``make test-more``."""
    dead: set[tuple[str, str]] = set()
    live: set[tuple[str, str]] = set()
    for item in items:
        few, case = item.get_closest_marker("few"), getattr(item, "callspec", None)
        if few and case:
            name = item.nodeid.partition("[")[0]
            named = {(name, i) for i in few.args if fnmatchcase(case.id, i)}
            live |= named
            dead |= {(name, i) for i in few.args}
            if not named:
                item.add_marker("more")
    if dead - live and not any("[" in asked for asked in config.args):
        raise pytest.UsageError(f"marks `few` for cases that are not there: {sorted(dead - live)}")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The full set of DART recordings; a test that needs it is skipped where it is absent."""
    places = [os.environ.get("DART_DATA"), HOME.parent / "shared" / "data" / "dart"]
    for place in places:
        if place and Path(place).is_dir():
            return Path(place)
    pytest.skip(f"full recordings absent: $DART_DATA is {places[0]!r} and {places[1]} is no folder")


@pytest.fixture(scope="session")
def other_cars() -> Path:
    """Recordings of other cars than DART's; a test that needs them is skipped where absent."""
    places = [os.environ.get("OTHER_CARS_DATA"), HOME.parent / "shared" / "data" / "other"]
    for place in places:
        if place and Path(place).is_dir():
            return Path(place)
    pytest.skip(f"recordings of other cars absent: $OTHER_CARS_DATA is {places[0]!r} and "
                f"{places[1]} is no folder")


@pytest.fixture
def armed_esc(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate cars whose ESC an earlier program has armed: they arm without 2 s of neutral.

    For tests of a car that drives, where this wait is half of what is simulated. Not for tests of
    the neutral itself, nor for cars that a fixture of a module opens.
    """
    from dart_lab.sim import car_file
    from dart_lab.sim.esc import Esc, EscParams

    usual = "arm_neutral = 2.0"
    assert usual in car_file._TEXT
    monkeypatch.setattr(car_file, "_TEXT", car_file._TEXT.replace(
        usual, f"arm_neutral = {SHORT_NEUTRAL}"))
    start = Esc.__init__

    def start_armed(esc: Esc, params: EscParams | None = None) -> None:
        start(esc, params)
        esc._needed = SHORT_NEUTRAL

    monkeypatch.setattr(Esc, "__init__", start_armed)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    expected = hasattr(report, "wasxfail")
    if IN_CI and report.skipped and not expected and item.get_closest_marker("emulator"):
        report.outcome = "failed"
        report.longrepr = f"not skipped on a build server: {report.longrepr}"
    return report


@pytest.fixture(autouse=True)
def no_car_of_the_user(monkeypatch, tmp_path_factory):
    """Neither the environment nor the home folder of the developer decides a test."""
    monkeypatch.delenv("DART_HAL_URL", raising=False)
    monkeypatch.delenv("DART_CARS", raising=False)
    monkeypatch.delenv("DART_HAL_CAR", raising=False)
    share = tmp_path_factory.getbasetemp() / f"share-{next(TESTS)}"
    monkeypatch.setenv("XDG_DATA_HOME", str(share))
    if any((HOME / "cars").glob("sim-*")):  # simulated cars that were calibrated in this checkout
        monkeypatch.setenv("DART_CARS", str(share / "cars"))
