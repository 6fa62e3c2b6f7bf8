"""Single decisions of the safety layers, each measured at the ESC pin with and without it."""

from __future__ import annotations

import threading
from unittest.mock import Mock, patch

import pytest
from fault_table.drive import MAX_PWM_PERIOD_S, WAIVED, Drive, forward

from dart_hal.car.cutoff_test import CutoffTest
from dart_hal.car.driver import Driver
from dart_hal.car.engine import Engine
from dart_hal.car.facts import MAX_SWITCH_ON_TIME, Observer
from dart_hal.car.guarding import GuardPost
from dart_hal.devices.actuation.arming import MIN_GOOD_TIME
from dart_lab.sim.faults import LineFaults

ARM_NEUTRAL = 2.0
"""s of neutral that the ESC must receive before the first throttle: car.toml's arm_neutral."""
MAX_ARM_NEUTRAL = ARM_NEUTRAL + 2 * MIN_GOOD_TIME
"""s after which it must be armed: the margin of ``OUTPUT_ON_AFTER``, ``MIN_GOOD_TIME``, and 0.4 s
for frames, beats and the answers of the Nano."""


def let_time_pass(drive: Drive, seconds: float) -> None:
    """Let the world go on after the car is closed."""
    end = drive.world.t + seconds
    while drive.world.t < end:
        drive.world.advance(end)


@pytest.mark.parametrize("counts", [True, False])
def test_esc_behind_oe_receives_its_whole_neutral_time(tmp_path, counts):
    """The outputs were off during the test. Control: write and count neutral meanwhile."""
    def written(observer, now, neutral_for, cutoff):
        return neutral_for

    method = Observer._neutral_for if counts else written
    silent = CutoffTest.silent if counts else False
    with (patch.object(Observer, "_neutral_for", method),
          patch.object(CutoffTest, "silent", silent),
          Drive(tmp_path, "&cutoff=oe") as drive):
        drive.run(2.2)
        drive.car.arm(waive=WAIVED)
        drive.run(0.2, forward(0.3))
        first = next(k for k, pulse in enumerate(drive.pulses) if drive.off(pulse))
        begin = first - 1
        while begin and drive.pulses[begin][0] - drive.pulses[begin - 1][0] < MAX_PWM_PERIOD_S:
            begin -= 1
        neutral = drive.pulses[first][0] - drive.pulses[begin][0]
    assert (neutral >= ARM_NEUTRAL) == counts, neutral
    assert neutral < MAX_ARM_NEUTRAL, neutral


@pytest.mark.parametrize("waits", [True, False])
@pytest.mark.parametrize("cutoff", ["oe", "mux"])
@pytest.mark.slow_except("mux-*")
def test_raw_waits_until_the_nano_passes_its_pulses(tmp_path, cutoff, waits):
    """Control: a driver that expects the pulses behind the cut-off at once ends raw()."""
    limit = MAX_SWITCH_ON_TIME if waits else 0.0
    with (patch("dart_hal.car.driver.MAX_SWITCH_ON_TIME", limit),
          Drive(tmp_path, f"&cutoff={cutoff}") as drive):
        drive.run(1.0)
        with drive.car.raw():
            drive.run(0.2, lambda car, state: car.pulses(steering_us=1500.0, throttle_us=1600.0))
            assert (drive.car.mode == "RAW") == waits
            assert drive.car.causes == (() if waits else ("CUT_OFF",))
    assert any(drive.off(pulse) for pulse in drive.pulses) == waits


@pytest.mark.parametrize(("cutoff", "pulse_us"), [("oe", 0.0), ("mux", 1500.0)])
@pytest.mark.parametrize("reports", [True, False])
@pytest.mark.slow_except("*-mux-*")
def test_state_reports_the_pulse_that_the_cutoff_leaves(tmp_path, cutoff, pulse_us, reports):
    """The Nano cuts because no beat reaches it. Control: report the pulses of the PCA9685."""
    method = Driver.apply_cutoff if reports else lambda driver, applied: applied
    with (patch.object(Driver, "apply_cutoff", method),
          Drive(tmp_path, f"&cutoff={cutoff}") as drive):
        drive.driving(seconds=0.1)
        start = drive.now
        drive.backend.link._down.faults = LineFaults(silence=[(start, start + 1.0)])
        states = drive.run(0.2, forward(0.4))
        first = next(state for state in states if "OUTPUT_LIVE" not in state.health.flags)
        assert ((first.applied.throttle, first.applied.throttle_us) == (0.0, pulse_us)) == reports
        assert ("CUT_OFF" in first.applied.limited) == reports


@pytest.mark.parametrize("closes", [True, False])
def test_closing_writes_neutral_while_another_thread_holds_the_lock(tmp_path, closes):
    """Control: a close that gives up where the lock is not free."""
    def give_up(engine):
        if engine._own_lock.acquire(timeout=0.02):
            engine.driver.close(engine.now)
            engine._own_lock.release()
        engine.driver.end_pulses = lambda: None

    with (patch.object(Engine, "close", Engine.close if closes else give_up),
          Drive(tmp_path, brief=True) as drive):
        drive.driving()
        held = threading.Event()
        release = threading.Event()

        def hold_lock():
            with drive.car._engine.lock:
                held.set()
                release.wait(20.0)

        thread = threading.Thread(target=hold_lock)
        thread.start()
        held.wait(20.0)
        start = drive.now
        try:
            drive.car.close()
        finally:
            release.set()
            thread.join()
        let_time_pass(drive, 0.2)
        duration = drive.last_off(start)
    assert (duration <= 20.0) == closes, duration


@pytest.mark.parametrize("prompt", [True, False])
def test_neutral_is_written_with_the_frame_that_reports_the_reboot(tmp_path, prompt):
    """Control: without the overdue write, neutral waits for the next PWM frame."""
    overdue = Driver.overdue if prompt else property(lambda driver: False)
    with (patch.object(Driver, "overdue", overdue),
          Drive(tmp_path, "&boot=none", brief=True) as drive):
        drive.driving(seconds=0.31)
        writes = record_writes(drive)
        known = len(drive.hellos)
        drive.fail("mcu:brownout")
        drive.run(0.1, forward(0.4, 0.5))
        reported = drive.hellos[known][0]
        delay = min(t - reported for t in writes if t >= reported)
    assert (delay < 1e-3) == prompt, delay


def record_writes(drive: Drive) -> list[float]:
    """Times [s] of the writes to the ESC's channel from now on."""
    times: list[float] = []
    write = drive.car._engine.driver.actuator.pca.write

    def note(counts):
        times.append(drive.now)
        write(counts)

    drive.car._engine.driver.actuator.pca.write = note
    return times


@pytest.mark.parametrize("throttle", [0.4, -0.4])
@pytest.mark.parametrize("notes", [True, False])
@pytest.mark.slow_except("True-*", "False--0.4")
def test_stalled_loop_disarms_in_both_directions(tmp_path, notes, throttle):
    """Control: an expiry without a reaction ends at neutral, but the car stays armed."""
    with Drive(tmp_path, brief=True) as drive:
        drive.arm().run(0.3, forward(throttle))
        start = drive.now
        actuator = drive.car._engine.driver.actuator
        if not notes:
            actuator._note_expiry = lambda now: None
        drive.run(0.6)
        assert drive.last_off(start) <= 520.0
        assert (drive.car.mode != "ARMED") == notes
        assert drive.car.causes == (("COMMAND_EXPIRED",) if notes else ())


def test_no_pulse_leaves_the_range_of_an_esc(tmp_path):
    """A neutral far off, as a wrong file would bring it, plus full throttle."""
    with Drive(tmp_path, brief=True) as drive:
        drive.arm()
        planner = drive.car._engine.driver.actuator._planner
        planner._neutral_us = 2100.0
        drive.run(0.6, forward(1.0))
        longest = max(fall - rise for rise, fall in drive.pulses)
        assert planner.throttle > 0.5, "the command arrives"
        assert longest <= 2.2500e-3 + 5e-6, longest
        planner._neutral_us = 900.0
        drive.run(0.6, forward(-1.0))
        shortest = min(fall - rise for rise, fall in drive.pulses)
    assert shortest >= 0.7500e-3 - 5e-6, shortest


class RecordingGuard:
    """In place of the guard process; records its commands."""

    def __init__(self) -> None:
        self.tripped = True
        self.events: list[str] = []

    def acknowledge(self) -> None:
        self.events.append("acknowledge")

    def beat(self, *, off: bool = False) -> None:
        self.events.append("beat")


@pytest.mark.parametrize("at_neutral", [True, False])
def test_guard_trip_is_acknowledged_at_neutral_alone(at_neutral):
    post = object.__new__(GuardPost)
    post._guard = RecordingGuard()
    post._actuator = Mock()
    post.beat(at_neutral=at_neutral)
    assert ("acknowledge" in post._guard.events) == at_neutral
    assert post._guard.events[-1] == "beat"


@pytest.mark.parametrize("held", [True, False])
def test_run_stop_ends_arming(tmp_path, held):
    """Control: a run-stop that is released does not."""
    with Drive(tmp_path, brief=True) as drive:
        drive.run(drive.settling)
        driver = drive.car._engine.driver
        driver.arm(drive.now, WAIVED)
        assert driver.mode == "ARMING"
        driver.set_run_stop(held, drive.now, "page")
        assert driver.mode == ("DISARMED" if held else "ARMING")
        assert driver.supervisor.reasons == (("RUN_STOP",) if held else ())
