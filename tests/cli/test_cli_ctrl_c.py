"""Ctrl-C while a verb drives, at every kind of moment, in virtual time."""

from __future__ import annotations

import signal

import pytest

from dart_lab.sim.world import THROTTLE_CHANNEL, World
from tests.common import MOCK_URL, NEUTRAL_TOLERANCE_US, NEUTRAL_US

NEUTRAL_WITHIN_S = 0.040
"""s from Ctrl-C to the last pulse that moves the car."""
CALIBRATE = ("calibrate", "steering", "--yes")
FOLLOW = ("follow", "eight", "--speed", 1, "--odometry")


class Finger:
    """Presses Ctrl-C at the so many-th pulse that moves the car; sees all pulses."""

    def __init__(self, nth: int) -> None:
        self.nth, self.moving, self.pressed_at = nth, 0, float("inf")
        self.pulses: list[tuple[float, float]] = []

    def __call__(self, channel: int, pulse: tuple[float, float]) -> None:
        if channel != THROTTLE_CHANNEL:
            return
        us = (pulse[1] - pulse[0]) * 1e6
        self.pulses.append((pulse[1], us))
        self.moving += abs(us - NEUTRAL_US) > NEUTRAL_TOLERANCE_US
        if self.moving == self.nth and self.pressed_at > pulse[1]:
            self.pressed_at = pulse[1]
            signal.raise_signal(signal.SIGINT)

    def moving_after(self, seconds: float) -> list[tuple[float, float]]:
        return [(t, us) for t, us in self.pulses
                if t > self.pressed_at + seconds and abs(us - NEUTRAL_US) > NEUTRAL_TOLERANCE_US]


@pytest.fixture
def press(verb, monkeypatch, tmp_path):
    """``press(nth, words)``: a verb, interrupted at that pulse; (what ran, the finger)."""
    def run(nth, words=CALIBRATE):
        finger = Finger(nth)
        made = World.__init__

        def make_watched_world(world, *args, **options):
            made(world, *args, **options)
            world.watchers.append(finger)

        monkeypatch.setattr(World, "__init__", make_watched_world)
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            done = run_and_interrupt(words)
        finally:
            signal.signal(signal.SIGINT, before)
        return done, finger

    def run_and_interrupt(words):
        """As a terminal runs it; a worker of the tests may ignore Ctrl-C."""
        return verb(*words, "--json", "--url", f"{MOCK_URL}&physics=kinematic", "--car", "mine",
                    "--cars", tmp_path / "cars")

    return run


@pytest.mark.parametrize("nth", [1, 37, 400])
@pytest.mark.slow
def test_ctrl_c_during_a_calibration_stops_and_writes_nothing(press, tmp_path, nth):
    done, finger = press(nth)
    assert finger.moving >= nth, "it was interrupted while it drove"
    assert (done.code, done.out) == (130, "")
    assert not finger.moving_after(NEUTRAL_WITHIN_S)
    assert abs(finger.pulses[-1][1] - NEUTRAL_US) <= NEUTRAL_TOLERANCE_US
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_ctrl_c_during_a_drive_reports_the_figures_so_far(press):
    done, finger = press(100, FOLLOW)
    assert done.code == 130
    assert not finger.moving_after(NEUTRAL_WITHIN_S)
    summary = done.json["summary"]
    assert (summary["ended"], summary["as_asked"]) == ("stopped by Ctrl-C", False)
    assert 0.0 < summary["offset_max_m"] < 0.3


@pytest.mark.slow
def test_without_neutral_at_the_end_it_drives_on(press, monkeypatch):
    """Control: a close that leaves the pins as they are."""
    monkeypatch.setattr("dart_hal.car.driver.Driver.close", lambda driver, now: None)
    monkeypatch.setattr("dart_hal.devices.actuation.chain.Actuator.stop",
                        lambda actuator: actuator.applied)
    assert abs(press(37)[1].pulses[-1][1] - NEUTRAL_US) > NEUTRAL_TOLERANCE_US
