"""Laws of the two actuators, by their pulses."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.vehicle import PAPER, make_steering
from dart_lab.sim.esc import Esc, EscMode, EscParams
from dart_lab.sim.servo import HORN_RAD_PER_US, ServoParams, SteeringServo

FRAME = 0.02


class EscBench:
    """Feeds an ESC with 50 Hz pulses."""

    def __init__(self, params=None):
        self.t = 0.0
        self.esc = Esc(params)

    def hold(self, width_us, seconds):
        for _ in range(round(seconds / FRAME)):
            self.t += FRAME
            self.esc.pulse((self.t - width_us * 1e-6, self.t))
            self.esc.check(self.t)
        return self.esc

    def silence(self, seconds):
        self.t += seconds
        self.esc.check(self.t)
        return self.esc

    def arm(self):
        self.hold(1500, 2.1)
        return self


def test_no_drive_before_two_seconds_of_neutral():
    bench = EscBench()
    assert bench.hold(1700, 5.0).throttle == 0.0
    bench.hold(1500, 1.9)
    assert bench.hold(1700, 0.1).throttle == 0.0          # the pull restarts the wait
    bench.hold(1500, 2.1)
    assert bench.hold(1700, 0.1).throttle == pytest.approx(200 / 450)


@given(pull=st.floats(-24.0, 24.0))
def test_dead_band(pull):
    assert EscBench().arm().hold(1500 + pull, 0.1).throttle == 0.0


@given(a=st.floats(26.0, 700.0), b=st.floats(26.0, 700.0))
def test_throttle_rises_with_the_pulse_up_to_saturation(a, b):
    low, high = sorted((a, b))
    first, second = (EscBench().arm().hold(1500 + d, 0.1).throttle for d in (low, high))
    assert 0.0 < first <= second <= 1.0
    assert second == pytest.approx(min(1.0, high / 450), abs=1e-9)


def test_pull_below_neutral_brakes_after_forward():
    bench = EscBench().arm()
    bench.hold(1800, 0.5)
    esc = bench.hold(1275, 0.5)
    assert (esc.mode, esc.throttle, esc.brake) == (EscMode.BRAKING, 0.0, pytest.approx(0.5))


def test_second_pull_after_a_rest_reverses():
    bench = EscBench().arm()
    bench.hold(1800, 0.5)
    bench.hold(1275, 0.5)
    bench.hold(1500, 0.2)
    esc = bench.hold(1275, 0.2)
    assert (esc.mode, esc.throttle, esc.brake) == (EscMode.REVERSE, pytest.approx(-0.5), 0.0)


def test_second_pull_without_a_rest_still_brakes():
    bench = EscBench().arm()
    bench.hold(1800, 0.5)
    bench.hold(1275, 0.5)
    bench.hold(1500, 0.06)
    assert bench.hold(1275, 0.2).mode is EscMode.BRAKING


def test_forward_again_must_brake_again():
    bench = EscBench().arm()
    for width in (1800, 1275, 1500, 1275, 1500, 1800, 1500):
        bench.hold(width, 0.3)
    assert bench.hold(1275, 0.2).mode is EscMode.BRAKING


def test_signal_loss_coasts_and_requires_neutral_first():
    bench = EscBench().arm()
    bench.hold(1800, 0.5)
    assert bench.silence(0.4).throttle > 0.5
    assert bench.silence(0.2).throttle == 0.0
    assert bench.hold(1800, 1.0).throttle == 0.0
    bench.hold(1500, 0.1)
    assert bench.hold(1800, 0.1).throttle > 0.5


def test_a_moved_neutral_is_not_neutral():
    """Why the PWM clock must be calibrated: 1558 us is throttle."""
    assert EscBench().arm().hold(1558.5, 0.1).throttle > 0.1
    shifted = EscBench(EscParams(neutral_us=1558.5))
    shifted.hold(1558.5, 2.1)
    assert shifted.hold(1500.0, 0.1).mode is EscMode.REVERSE


def drive(servo, width_us, seconds, t=0.0):
    angles = []
    for k in range(round(seconds * 1000)):
        now = t + k * 1e-3
        if k % 20 == 0 and width_us:
            servo.pulse((now - width_us * 1e-6, now))
        angles.append(servo.move(now, 1e-3))
    return angles


def test_servo_reaches_the_steering_map():
    curve = make_steering(PAPER.steering)
    for s in (-1.0, -0.3, 0.4, 1.0):
        servo = SteeringServo(ServoParams())
        assert drive(servo, 1500 + 375 * s, 1.0)[-1] == pytest.approx(curve(s), abs=1e-9)


def test_servo_keeps_its_rate():
    servo = SteeringServo(ServoParams())
    commands = []
    for k in range(300):
        if k % 20 == 0:
            servo.pulse((k * 1e-3 - 1875e-6, k * 1e-3))
        servo.move(k * 1e-3, 1e-3)
        commands.append(servo.command * 375 * HORN_RAD_PER_US)
    steps = [b - a for a, b in itertools.pairwise(commands)]
    assert max(steps) == pytest.approx(6e-3, rel=1e-9)
    assert commands[-1] == pytest.approx(375 * HORN_RAD_PER_US)
    assert sum(s > 1e-9 for s in steps) == pytest.approx(375 * HORN_RAD_PER_US / 6e-3, abs=2)


def test_servo_without_pulses_holds():
    servo = SteeringServo(ServoParams())
    held = drive(servo, 1700, 0.5)[-1]
    assert set(drive(servo, None, 2.0, t=0.5)) == {held}


def test_servo_ignores_what_is_no_servo_pulse():
    servo = SteeringServo(ServoParams())
    held = drive(servo, 1700, 0.5)[-1]
    assert drive(servo, 3144, 0.5, t=0.5)[-1] == held


def test_servo_delay_is_pure():
    early, late = SteeringServo(ServoParams()), SteeringServo(ServoParams(delay=0.03))
    a, b = drive(early, 1700, 0.3), drive(late, 1700, 0.3)
    assert b[30:] == pytest.approx(a[:-30], abs=1e-9)
    assert set(b[:30]) == {b[0]}


@pytest.mark.parametrize("backlash_deg", [0.3, 1.0, 2.0])
def test_backlash_loop_is_centred_on_the_map(backlash_deg):
    backlash = math.radians(backlash_deg)
    servo = SteeringServo(ServoParams(backlash=backlash))
    curve = make_steering(PAPER.steering)
    drive(servo, 1800, 1.0)
    from_left = drive(servo, 1500, 1.0, 1.0)[-1]
    drive(servo, 1200, 1.0, 2.0)
    from_right = drive(servo, 1500, 1.0, 3.0)[-1]
    assert from_left - from_right == pytest.approx(backlash, abs=1e-9)
    assert 0.5 * (from_left + from_right) == pytest.approx(curve(0.0), abs=1e-9)
