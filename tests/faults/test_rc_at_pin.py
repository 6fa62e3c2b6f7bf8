"""What the ESC gets while the driver of an RC transmitter overrides the program.

Every test has a negative control: the same drive without the layer that it is about. The limit of
a lost signal is 100 ms from its last pulse to the last pulse at the ESC that is not neutral.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from unittest.mock import patch

import numpy as np
import pytest
from fault_table.drive import WAIVED, Drive, forward
from fault_table.row import NEVER
from fault_table.rows_inputs import STICK_FORWARD_US

from dart_hal.car import rc
from dart_hal.core.errors import NotArmed
from dart_hal.devices.actuation import Actuator
from dart_hal.wire.codec import DOWN
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import BEAT_REQUESTS, HEARTBEAT
from dart_lab.sim.rc import RECEIVER_PERIOD, RECEIVER_PINS, STICK_REST_US, PinInput, SimReceiver

MAX_LOSS_MS = 100.0
STICK_FULL_US = 2000.0
STICK_BACK_US = 1200.0
PROGRAM_DRIVES = forward(0.4)
STEERING_STICK, THROTTLE_STICK, MODE_CHANNEL = range(3)
WITH_SWITCH = (r"\[rc\]", "[rc]\nmode_us = 1500.0")


class RcDrive(Drive):
    """A simulated car with an RC receiver; ``stick``: moves a stick, None: its pulses end."""

    def __init__(self, folder, nano="mock", **options):
        super().__init__(folder, "&rc=1", nano=nano, brief=True, **options)

    def stick(self, channel: int, pulse_us: float | None) -> float:
        """Move a stick from the next pulse on; return the time."""
        self.world.receiver.pulses_us[channel] = pulse_us
        return self.now

    def lose_signal(self) -> float:
        """End all pulses at once; return the end of the last one."""
        receiver = self.world.receiver
        end = receiver._next - receiver._period + 1e-6 * sum(filter(None, receiver.pulses_us))
        receiver.pulses_us = [None, None, None]
        return end

    def pulses_us(self, since: float) -> np.ndarray:
        """Pulses at the ESC [us] that began after ``since`` [s]."""
        return np.array([1e6 * (fall - rise) for rise, fall in self.pulses if rise >= since])

    @property
    def neutral_us(self) -> float:
        return 1e6 * self.neutral


class NoisyPins(SimReceiver):
    """No receiver: wires that catch random edges at a rate [1/s]."""

    def __init__(self, rate: float) -> None:
        super().__init__()
        self._rng = np.random.default_rng(3)
        self._rate = rate
        self._level = False

    def edges(self, start: float, end: float) -> list[PinInput]:
        found = []
        for pin in RECEIVER_PINS:
            times = self._rng.uniform(start, end, self._rng.poisson(self._rate * (end - start)))
            for t in sorted(times):
                self._level = not self._level
                found.append((float(t), pin, self._level))
        return sorted(found)


@pytest.mark.slow_except("True-mock")
@pytest.mark.parametrize("nano", ["mock", "avr"])
@pytest.mark.parametrize("overrides", [True, False])
def test_the_driver_overrides_the_program(tmp_path, nano, overrides):
    """Full stick forward against a program at 0.4. Control: the actuator ignores the driver."""
    method = Actuator.set_override if overrides else lambda actuator, command: None
    with patch.object(Actuator, "set_override", method), RcDrive(tmp_path, nano) as drive:
        drive.driving(0.4)
        program = drive.pulses_us(drive.now - 0.1)
        began = drive.stick(THROTTLE_STICK, STICK_FULL_US)
        states = drive.run(0.3, PROGRAM_DRIVES)
        driven = drive.pulses_us(began + 0.1)
        assert (driven.min() > program.max() + 100.0) == overrides
        assert ("RC_OVERRIDE" in states[-1].applied.limited) == overrides
        applied = drive.car.drive(throttle=0.4)
        assert ("OVERRIDDEN(rc)" in applied.limited) == overrides


@pytest.mark.slow
def test_the_override_obeys_the_limits_of_the_car(tmp_path):
    """Full stick with [limits] max_throttle 0.5 and a slew rate of 1 per second."""
    limits = (r"\[rc\]", "[rc]\n[limits]\nmax_throttle = 0.5\nthrottle_slew = 1.0")
    with RcDrive(tmp_path, edit=limits) as drive:
        drive.arm().run(0.2, forward(0.0))
        began = drive.stick(THROTTLE_STICK, STICK_FULL_US)
        drive.run(0.9, forward(0.0))
        span = drive.car.files.config.throttle.span_us
        assert drive.pulses_us(began).max() == pytest.approx(drive.neutral_us + 0.5 * span, abs=6.0)
        assert np.diff(drive.pulses_us(began)).max() < 0.02 * span + 6.0


@pytest.mark.slow
@pytest.mark.parametrize("commands", [True, False])
def test_the_program_drives_again_after_neutral(tmp_path, commands):
    """Control: without a new command the pin stays at neutral, also after an earlier request."""
    with RcDrive(tmp_path) as drive:
        drive.driving(0.4)
        drive.stick(THROTTLE_STICK, STICK_BACK_US)
        drive.run(0.2, forward(0.4, valid_for=0.5))
        released = drive.stick(THROTTLE_STICK, STICK_REST_US)
        drive.run(rc.RELEASE_TIME + 0.4, PROGRAM_DRIVES if commands else None)
        rest = drive.pulses_us(released + 0.08)[:int(0.8 * rc.RELEASE_TIME / RECEIVER_PERIOD)]
        assert np.abs(rest - drive.neutral_us).max() < 5.0
        last = drive.pulses_us(drive.now - 0.1)
        assert (last.min() > drive.neutral_us + 100.0) == commands
        assert drive.car.mode == "ARMED"


def no_pulses(drive: RcDrive) -> float:
    return drive.lose_signal()


def no_throttle_wire(drive: RcDrive) -> float:
    drive.stick(THROTTLE_STICK, None)
    return drive.now + RECEIVER_PERIOD


def too_long(drive: RcDrive) -> float:
    drive.stick(THROTTLE_STICK, 2300.0)
    return drive.now + RECEIVER_PERIOD


def too_short(drive: RcDrive) -> float:
    drive.stick(STEERING_STICK, 700.0)
    return drive.now + RECEIVER_PERIOD


def no_messages(drive: RcDrive) -> float:
    drive.car._engine.receiver.handlers["RC"] = lambda values, t: None
    return drive.now


LOSSES = (no_pulses, no_throttle_wire, too_long, too_short, no_messages)


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_a_lost_signal_is_neutral_within_100_ms(tmp_path, loss):
    with RcDrive(tmp_path, "avr") as drive:
        drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
        drive.run(0.2, forward(0.0))
        since = loss(drive)
        drive.run(0.4, PROGRAM_DRIVES)
        assert 0.0 < drive.last_off(since) <= MAX_LOSS_MS
        assert drive.car.mode == "TRIPPED"
        assert drive.car.causes == ("RC_LOST",)
        assert "RC_LOST" in drive.states[-1].applied.limited
        drive.run(0.6)
        with pytest.raises(NotArmed, match="RC_LOST"):
            drive.car.arm(waive=WAIVED)


@pytest.mark.slow_except("0.0156")
@pytest.mark.parametrize("offset", [k * 2.6e-3 for k in range(8)])
def test_a_lost_signal_at_any_phase_of_the_pwm_frame(tmp_path, offset):
    with RcDrive(tmp_path, opened=offset) as drive:
        drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
        drive.run(0.2 + 0.7 * offset, forward(0.0))
        since = drive.lose_signal()
        drive.run(0.3, PROGRAM_DRIVES)
        assert 0.0 < drive.last_off(since) <= MAX_LOSS_MS


def test_a_silent_line_during_an_override_is_a_stale_link(tmp_path):
    with RcDrive(tmp_path) as drive:
        drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
        drive.run(0.2, forward(0.0))
        since = drive.silence()
        drive.run(0.4)
        assert 0.0 < drive.last_off(since) <= MAX_LOSS_MS
        assert drive.car.causes == ("LINK_STALE",)


@pytest.mark.slow
@pytest.mark.parametrize("on_the_nano", [True, False])
def test_delays_of_the_line_are_no_loss(tmp_path, on_the_nano):
    """Messages come up to 40 ms late. Control: the age on the clock of the host."""
    with RcDrive(tmp_path, "mock&jitter=busy&seed=3&physics=kinematic") as drive:
        drive.run(3.0)
        drive.car.arm(waive=WAIVED)
        drive.stick(STEERING_STICK, STICK_FULL_US)
        handlers = drive.car._engine.receiver.handlers
        add = handlers["RC"]
        ends = [drive.now]

        def note_end(values, t):
            ends.append(t - 1e-3 * max(values["age"][:2]))
            add(values, t)

        def is_recent(override, state_ck):
            return drive.now - ends[-1] <= rc.MAX_PULSE_AGE

        handlers["RC"] = note_end
        method = rc.RcOverride.has_signal if on_the_nano else is_recent
        with patch.object(rc.RcOverride, "has_signal", method):
            drive.run(4.0, forward(0.0))
        assert (drive.car.mode == "ARMED") == on_the_nano


@pytest.mark.slow
def test_control_without_the_age_limit_a_lost_signal_drives_on(tmp_path):
    with patch.object(rc, "MAX_PULSE_AGE", 10.0), RcDrive(tmp_path) as drive:
        drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
        drive.run(0.2, forward(0.0))
        drive.car._engine.receiver.handlers["RC"] = lambda values, t: None
        since = drive.now
        drive.run(0.4, PROGRAM_DRIVES)
        assert drive.last_off(since) == NEVER


@pytest.mark.slow
def test_one_missing_pulse_is_no_loss(tmp_path):
    with RcDrive(tmp_path) as drive:
        drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
        for _ in range(6):
            drive.run(0.107, forward(0.0))
            drive.world.receiver._next += RECEIVER_PERIOD
        drive.run(0.1, forward(0.0))
        assert drive.car.mode == "ARMED"
        assert "RC_OVERRIDE" in drive.states[-1].applied.limited


def ramp_up(drive: RcDrive) -> None:
    """The slew rate has not let the throttle reach its stick yet."""
    drive.arm().stick(THROTTLE_STICK, STICK_FULL_US)
    drive.run(0.4, forward(0.0))


def reverse(drive: RcDrive) -> None:
    """The driver brakes out of forward throttle, then goes backward."""
    drive.arm().stick(THROTTLE_STICK, STICK_FORWARD_US)
    drive.run(0.4, forward(0.0))
    drive.stick(THROTTLE_STICK, STICK_BACK_US)
    drive.run(0.1, forward(0.0))
    drive.stick(THROTTLE_STICK, STICK_REST_US)
    drive.run(0.1, forward(0.0))
    drive.stick(THROTTLE_STICK, STICK_BACK_US)
    drive.run(0.1, forward(0.0))


def stop(drive: RcDrive) -> None:
    """The program has disarmed the car, and its throttle is on the ramp of a stop."""
    drive.arm().stick(THROTTLE_STICK, STICK_FULL_US)
    drive.run(0.4, forward(0.0))
    drive.car.stop()
    drive.run(0.06)


SLOW_THROTTLE = (r"\[rc\]", "[rc]\n[limits]\nthrottle_slew = 1.0")
STOP_RAMP = (r"arm_neutral = 0\.1", "arm_neutral = 0.1\nstop_ramp = 2.0")


@pytest.mark.slow
@pytest.mark.parametrize(("transition", "edit", "ends"), [
    (ramp_up, SLOW_THROTTLE, "TRIPPED"), (reverse, SLOW_THROTTLE, "TRIPPED"),
    (reverse, STOP_RAMP, "TRIPPED"), (stop, STOP_RAMP, "DISARMED")])
@pytest.mark.parametrize("at_once", [True, False])
def test_a_lost_signal_in_a_transition(tmp_path, transition: Callable[[RcDrive], None], edit, ends,
                                       at_once):
    """Control, of a ramp of a stop: write neutral by the ramp."""
    method = Actuator.stop_at_once if at_once else Actuator.stop
    with (patch.object(Actuator, "stop_at_once", method),
          RcDrive(tmp_path, edits=[edit]) as drive):
        transition(drive)
        assert drive.off(drive.pulses[-1])
        since = drive.lose_signal()
        drive.run(0.4, PROGRAM_DRIVES)
        assert (drive.last_off(since) <= MAX_LOSS_MS) == (at_once or edit is SLOW_THROTTLE)
        assert drive.car.mode == ends


@pytest.mark.slow_except("True")
@pytest.mark.parametrize("lost", [True, False])
def test_a_lost_signal_during_arming_ends_it_at_neutral(tmp_path, lost):
    """Control: with the signal the car arms, and the driver drives."""
    with RcDrive(tmp_path, edit=WITH_SWITCH) as drive:
        drive.stick(MODE_CHANNEL, 1900.0)
        drive.run(drive.settling)
        with pytest.raises(NotArmed, match="RC_LOST") if lost else nullcontext():
            for _ in drive.car.arming(waive=WAIVED):
                if lost and drive.now > drive.settling + 0.2:
                    drive.lose_signal()
        drive.stick(THROTTLE_STICK, None if lost else STICK_FORWARD_US)
        drive.run(0.2, forward(0.0))
        assert drive.car.mode == ("DISARMED" if lost else "ARMED")
        assert drive.off(drive.pulses[-1]) != lost
        if lost:
            assert np.abs(drive.pulses_us(0.0) - drive.neutral_us).max() < 5.0


@pytest.mark.slow
def test_a_disarmed_car_does_not_drive_by_rc(tmp_path):
    """Nor does it jump when it is armed: the stick must rest first. Control: then it drives."""
    with RcDrive(tmp_path, "avr") as drive:
        drive.stick(THROTTLE_STICK, STICK_FULL_US)
        drive.run(0.6)
        drive.arm().run(0.4, PROGRAM_DRIVES)
        assert drive.car.mode == "ARMED"
        assert np.abs(drive.pulses_us(0.0) - drive.neutral_us).max() < 5.0
        assert "RC_OVERRIDE" in drive.states[-1].applied.limited
        drive.stick(THROTTLE_STICK, STICK_REST_US)
        drive.run(0.1)
        drive.stick(THROTTLE_STICK, STICK_FORWARD_US)
        drive.run(0.2)
        assert drive.wrong(drive.pulses[-1])


@pytest.mark.slow
def test_the_switch_overrides_with_resting_sticks(tmp_path):
    with RcDrive(tmp_path, edit=WITH_SWITCH) as drive:
        drive.stick(MODE_CHANNEL, 1100.0)
        drive.driving(0.4)
        assert "RC_OVERRIDE" not in drive.states[-1].applied.limited
        began = drive.stick(MODE_CHANNEL, 1900.0)
        drive.run(rc.RELEASE_TIME + 0.3, PROGRAM_DRIVES)
        assert np.abs(drive.pulses_us(began + 0.1) - drive.neutral_us).max() < 5.0
        ended = drive.stick(MODE_CHANNEL, 1100.0)
        drive.run(0.2, PROGRAM_DRIVES)
        assert drive.pulses_us(ended + 0.1).min() > drive.neutral_us + 100.0


@pytest.mark.slow_except("False")
@pytest.mark.parametrize("drops", [True, False])
def test_a_request_made_during_the_override_does_not_come_back(tmp_path, drops):
    """The switch ends it, and the program sends nothing more. Control: keep its requests."""
    def keep_requests(actuator, command):
        actuator._planner.override = command

    method = Actuator.set_override if drops else keep_requests
    with (patch.object(Actuator, "set_override", method),
          RcDrive(tmp_path, edit=WITH_SWITCH) as drive):
        drive.stick(MODE_CHANNEL, 1900.0)
        drive.arm().run(0.4, forward(0.4, valid_for=0.5))
        ended = drive.stick(MODE_CHANNEL, 1100.0)
        drive.run(0.3)
        rest = drive.pulses_us(ended)
        assert (np.abs(rest - drive.neutral_us).max() < 5.0) == drops
        assert drive.car.mode == "ARMED"


@pytest.mark.slow
def test_a_request_that_expires_during_the_override_is_no_trip(tmp_path):
    """Control: without the override it is one."""
    for override, mode in ((True, "ARMED"), (False, "TRIPPED")):
        with RcDrive(tmp_path, edit=WITH_SWITCH) as drive:
            drive.stick(MODE_CHANNEL, 1900.0 if override else 1100.0)
            drive.arm().run(0.2, forward(0.4))
            drive.run(0.4)
            assert drive.car.mode == mode


def test_an_override_ends_raw_pulses(tmp_path):
    with RcDrive(tmp_path) as drive:
        drive.run(drive.settling + 0.5)
        with drive.car.raw():
            drive.run(0.2, lambda car, state: car.pulses(steering_us=1500.0, throttle_us=1600.0))
            assert drive.wrong(drive.pulses[-1])
            began = drive.stick(STEERING_STICK, STICK_FULL_US)
            drive.run(0.2, lambda car, state: car.pulses(steering_us=1500.0, throttle_us=1600.0))
            assert drive.last_off(began) <= MAX_LOSS_MS
            assert drive.car.causes == ("RC_OVERRIDE",)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [150.0, 3000.0])
def test_noise_on_open_pins_is_no_command(tmp_path, rate):
    """Control: the same pins with a receiver override the program, above."""
    with RcDrive(tmp_path, "avr", prepare=lambda world: setattr(
            world, "receiver", NoisyPins(rate))) as drive:
        drive.driving(0.4)
        began = drive.now
        states = drive.run(0.5, PROGRAM_DRIVES)
        assert "RC_OVERRIDE" not in {name for s in states for name in s.applied.limited}
        assert drive.pulses_us(began + 0.05).min() > drive.neutral_us + 100.0
        assert drive.car.mode == "ARMED"
        assert not any("SLOT_OVERRUN" in s.health.flags for s in states)


@pytest.mark.slow
@pytest.mark.parametrize("configured", [True, False])
def test_a_car_without_a_receiver_exchanges_the_same_bytes(tmp_path, configured):
    """The real firmware, with and without pulses on its pins. Control: with [rc] they differ."""
    streams = []
    for pulses in (True, False):
        heard = []
        rc_table = [] if configured else [(r"\[rc\]", "")]
        with RcDrive(tmp_path, "avr", edits=rc_table) as drive:
            if not pulses:
                drive.world.receiver = None
            drive.car.on_bytes(lambda way, data, t, heard=heard: heard.append((way, data)) or data)
            drive.run(0.5, PROGRAM_DRIVES)
        streams.append(heard)
    assert (streams[0] == streams[1]) != configured
    decoder = FrameDecoder(DOWN)
    sent = [frame for way, data in streams[0] if way == "tx" for frame in decoder.feed(data)]
    requests = {frame.as_dict()["flags"] & sum(BEAT_REQUESTS.values())
                for frame in sent if frame.message is HEARTBEAT}
    assert requests == {BEAT_REQUESTS["RC"] if configured else 0}
