"""A suspend of the computer is noticed, and ages go on during it."""

from __future__ import annotations

import time

import pytest

from dart_hal.core.process import suspend
from dart_hal.core.process.suspend import SuspendDetector, elapsed, elapsed_ns
from dart_hal.devices.links.serial_port import RealClock


class Clocks:
    """boot goes on while the computer sleeps, awake does not; each reading takes ``reading`` s."""

    def __init__(self) -> None:
        self.t, self.asleep, self.reading = 100.0, 5.0, 1e-6

    def awake(self) -> float:
        self.t += self.reading
        return self.t

    def boot(self) -> float:
        self.t += self.reading
        return self.t + self.asleep

    def sleep(self, seconds: float) -> None:
        self.asleep += seconds


def test_a_suspend_is_noticed_once():
    clocks = Clocks()
    detector = SuspendDetector(clocks.boot, clocks.awake)
    for _ in range(100):
        clocks.t += 0.02
        assert not detector.was_suspended()
    clocks.sleep(3.0)
    assert detector.was_suspended()
    assert not detector.was_suspended()
    clocks.sleep(0.3)
    assert detector.was_suspended()


def test_a_process_without_the_processor_is_no_suspend():
    clocks = Clocks()
    detector = SuspendDetector(clocks.boot, clocks.awake)
    clocks.reading = 0.5                       # every reading is interrupted for half a second
    assert not detector.was_suspended()
    clocks.reading = 1e-6
    clocks.t += 10.0                           # it was stopped for 10 s; both clocks went on
    assert not detector.was_suspended()
    clocks.sleep(2.0)
    clocks.reading = 0.5
    assert not detector.was_suspended()
    clocks.reading = 1e-6
    assert detector.was_suspended(), "it is noticed at the next good reading"


def test_ages_go_on_during_a_suspend(monkeypatch):
    """CLOCK_MONOTONIC stops, CLOCK_BOOTTIME does not."""
    still, boot = time.monotonic(), [5000.0]
    monkeypatch.setattr(time, "monotonic", lambda: still)
    monkeypatch.setattr(time, "clock_gettime", lambda clock: boot[0])
    clock = RealClock()
    before = clock.now()
    boot[0] += 3.0
    assert clock.now() - before == pytest.approx(3.0)


def test_control_on_the_monotonic_clock_they_do_not(monkeypatch):
    still = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: still)
    monkeypatch.setattr(suspend, "_BOOTTIME", None)
    assert elapsed() == still


def test_a_platform_without_the_clock_falls_back(monkeypatch):
    monkeypatch.setattr(suspend, "_BOOTTIME", None)
    assert elapsed() == pytest.approx(time.monotonic(), abs=1.0)
    assert elapsed_ns() == pytest.approx(time.monotonic_ns(), abs=1e9)
    assert not SuspendDetector().was_suspended()


def test_both_units_agree():
    assert elapsed_ns() * 1e-9 == pytest.approx(elapsed(), abs=1.0)
