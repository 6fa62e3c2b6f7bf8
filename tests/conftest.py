"""What all tests share: on a build server a missing emulator is a failure, not a skip."""

from __future__ import annotations

import gc
import itertools
import os
import time
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy comes: two processes of tests fill two cores, and threads of a linear algebra would
# wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

IN_CI = os.environ.get("CI", "").lower() in ("1", "true", "yes")

if IN_CI:
    os.environ.setdefault("DART_HAL_REQUIRE_EMULATOR", "1")


# How long an example takes is the machine's: no deadline.
settings.register_profile("dev", deadline=None, max_examples=10)
settings.register_profile("ci", deadline=None, max_examples=200)
settings.load_profile("dev")

HOME = Path(__file__).resolve().parents[1]

CPU_PRESSURE = Path("/proc/pressure/cpu")
"""Linux: how long some task was ready and waited for a processor (the kernel's PSI)."""
MAX_WAITING_SHARE = 0.5
"""Share of a test's time. Above it the computer was too busy to keep real time: two busy programs
and two slow tests on two cores give .85 to .99, one slow test at a time .01 to .25."""

TESTS = itertools.count()
SHORT_NEUTRAL = 0.1
"""s of neutral that an ESC needs where it was armed before: five pulses."""


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
    """Mark each case that ``slow_except`` or ``long_except`` of its test does not name.

    It becomes slow or long. Raises UsageError if a name fits no case.
    """
    fits: dict[tuple[str, str], bool] = {}
    for item in items:
        if item.get_closest_marker("realtime"):
            item.add_marker(pytest.mark.flaky(reruns=2, condition=was_busy))
        case = getattr(item, "callspec", None)
        test = item.nodeid.partition("[")[0]
        for kind in ("slow", "long"):
            mark = item.get_closest_marker(f"{kind}_except")
            if mark and case:
                own = {(test, name): fnmatchcase(case.id, name) for name in mark.args}
                fits |= {key: fit or fits.get(key, False) for key, fit in own.items()}
                if not any(own.values()):
                    item.add_marker(kind)
    wrong = sorted(key for key, fit in fits.items() if not fit)
    if wrong and not any("[" in argument for argument in config.args):
        raise pytest.UsageError(
            f"marks `slow_except` or `long_except` for cases that do not exist: {wrong}")


def read_waiting_time() -> tuple[float, float]:
    """Read the time [s], and how long until now some task waited for a processor [s]."""
    waited = CPU_PRESSURE.read_text().split("total=")[1].split()[0] if CPU_PRESSURE.exists() else 0
    return time.monotonic(), int(waited) * 1e-6


def was_busy() -> bool:
    """Whether other programs kept the processors busy during the present test.

    A test in real time that fails on such a computer is repeated, twice at most. On one that has
    time its first failure counts.
    """
    (begun, waited_before), (now, waited) = STARTED[-1], read_waiting_time()
    return waited - waited_before > MAX_WAITING_SHARE * (now - begun)


STARTED = [read_waiting_time()]
"""When the present test began, as ``read_waiting_time`` states it."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Note how busy the computer is when a test, or its repetition, begins."""
    STARTED[:] = [read_waiting_time()]


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
    assert usual in car_file._CAR_TOML
    monkeypatch.setattr(car_file, "_CAR_TOML", car_file._CAR_TOML.replace(
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
