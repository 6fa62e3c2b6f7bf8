"""Processor time of every test: ``make test`` stays quick because a slow test fails it.

Counted are seconds of this process and its children, not of the wall: what
else the machine does is no fault of the test. They are divided by how much
slower than the reference a fixed loop runs here. Not charged to the test that
happens to come first: fixtures that others share (``SHARED`` holds for each of
them), and what the next run finds made: compiled kernels, hypothesis's table of
all characters.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import pytest

SHARED = 5.0
"""CPU s of one fixture of a module or of the session."""
NOISE = 1.5
"""A test is late from this many times its limit on: the same test takes a third more or less CPU
time, with what caches hold and what the other core does."""
LOOP, REFERENCE = 400_000, 0.021
"""Additions, and CPU s that they take on the machine whose seconds the limits mean."""
CACHES = (Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dart-hal" / "kernels",
          Path(".hypothesis/unicode_data"))
"""Folders of what is made once."""


def used() -> float:
    """CPU s of this process and of its children that have ended."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system


def cached() -> int:
    """Return a number that changes when a file is added to a cache."""
    changed = 0
    for cache in CACHES:
        if not cache.is_dir():
            continue
        changed += cache.stat().st_mtime_ns
        with os.scandir(cache) as entries:  # called for each test: a glob takes five times as long
            changed += sum(entry.stat().st_mtime_ns for entry in entries if entry.is_dir())
    return changed


def slowness() -> float:
    """How many times as long as on the reference machine a loop takes here, at least 1."""
    took = []
    for _ in range(7):
        begin, total = time.process_time(), 0
        for k in range(LOOP):
            total += k
        took.append(time.process_time() - begin)
    return max(median(took) / REFERENCE, 1.0)


class Watch:
    """pytest plugin: fails a run with a test above its limit, and says which.

    ``limit``: CPU s of a test without a mark ``cpu``, ``more`` or ``slow``; 0
    judges nothing. ``keep``: a file for every test's seconds. The processes of
    xdist measure, the one that reports judges.
    """

    def __init__(self, limit: float, keep: Path | None = None) -> None:
        self._limit, self._keep = limit, keep
        self._slowness = slowness()
        self._begin, self._cached, self._shared = used(), cached(), 0.0
        self._seconds: dict[str, float] = {}
        self._late: list[tuple[float, float, str]] = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        self._begin, self._cached, self._shared = used(), cached(), 0.0

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object],
                             request: pytest.FixtureRequest) -> Iterator[None]:
        begin, inner = used(), self._shared
        made = yield
        if fixturedef.scope != "function":
            own = used() - begin - (self._shared - inner)
            self._shared += own
            item = request._pyfuncitem
            name = f"{item.nodeid.split('::')[0]}: fixture {fixturedef.argname}"
            item.user_properties.append(("cpu", self._charged(name, own, item, SHARED)))
        return made

    def _charged(self, name: str, seconds: float, item: pytest.Item, limit: float,
                 ) -> tuple[str, float, float]:
        """(what took them, CPU s on the reference machine, CPU s that it may take)."""
        mark = item.get_closest_marker("cpu")
        allowed = max(limit, mark.args[0]) if mark else limit
        late = seconds / self._slowness > NOISE * allowed
        if late and (self._cached != cached()
                     or any(map(item.get_closest_marker, ("more", "slow")))):
            allowed = float("inf")
            late = False
        if self._limit and late:  # a neighbour may have come since
            self._slowness = max(self._slowness, slowness())
        return name, seconds / self._slowness, allowed

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Iterator[None]:
        report = yield
        if report.when == "teardown":
            own = used() - self._begin - self._shared
            report.user_properties.append(
                ("cpu", self._charged(report.nodeid, own, item, self._limit)))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "teardown":
            for key, value in report.user_properties:
                if key == "cpu":
                    name, seconds, allowed = value
                    self._seconds[name] = self._seconds.get(name, 0.0) + seconds
                    if seconds > NOISE * allowed:
                        self._late.append((seconds, allowed, name))

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._limit and self._late and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        if self._keep is not None:
            rows = sorted(self._seconds.items(), key=lambda row: -row[1])
            self._keep.write_text("".join(f"{s:.2f} {name}\n" for name, s in rows),
                                  encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for seconds, allowed, name in sorted(self._late, reverse=True) if self._limit else ():
            terminalreporter.write_line(
                f"TOO SLOW  {name}: {seconds:.1f} CPU s, allowed {allowed:g}. Less of it, or the "
                "mark `more` and something quicker in its place")
