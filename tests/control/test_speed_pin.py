"""The ESC pin under ``drive_speed``: nothing above neutral where no forward speed is requested."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.control import loop
from dart_hal.control.loop import SpeedLoop
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

PULSE_DELAY_S = 0.040  # s: the PWM frame under way and the next, as for every command
MOVES_AT = 1.0  # s of driving forward


def pulses(change, seconds=1.2):
    """(t after the change, width [us]) on the ESC's pin of a car that drove forward.

    ``change(t)``: target speed t s after the change, None: it is stopped, which disarms it.
    """
    backend = open_backend("sim://?nano=mock")
    pulse_log = []
    changed = None
    world = world_of(backend)
    world.watchers.append(lambda channel, pulse: pulse_log.append(pulse) if channel == 1 else None)
    with Car.over(backend) as car:
        car.arm()
        start = None
        for state in car.states(duration=MOVES_AT + seconds):
            start = state.t if start is None else start
            t = state.t - start - MOVES_AT
            target = 0.8 if t < 0.0 else change(t)
            if t >= 0.0 and changed is None:
                assert state.speed > 0.5
                changed = world.t
            if target is None:
                car.stop()
                break
            car.drive_speed(steering=0.0, speed=target)
        for _ in car.states(duration=0.3):
            pass
    ends = world.t
    return [(fall - changed, (fall - rise) * 1e6) for rise, fall in pulse_log
            if changed + PULSE_DELAY_S < fall < ends]


def nothing_drives_forward(widths):
    assert widths
    assert max(width for _, width in widths) <= NEUTRAL_US + NEUTRAL_TOLERANCE_US


def test_a_target_of_zero_is_neutral():
    widths = pulses(lambda t: 0.0)
    nothing_drives_forward(widths)
    assert min(width for _, width in widths) >= NEUTRAL_US - NEUTRAL_TOLERANCE_US


@pytest.mark.parametrize("t_stop", [0.0, 0.1, pytest.param(0.5, marks=pytest.mark.slow),
                                    pytest.param(0.9, marks=pytest.mark.slow)])
@pytest.mark.slow_except("0.0")
def test_a_stop_while_the_car_reverses_is_neutral(t_stop):
    """Before, in the brake, at rest and in reverse: never forward, and neutral in the end."""
    widths = pulses(lambda t: -0.5 if t < t_stop else None)
    nothing_drives_forward(widths)
    late = [width for t, width in widths if t > t_stop + PULSE_DELAY_S + 0.02]
    assert late
    assert min(late) >= NEUTRAL_US - NEUTRAL_TOLERANCE_US


def test_a_target_of_zero_while_the_esc_brakes_is_neutral():
    widths = pulses(lambda t: -0.5 if t < 0.1 else 0.0)
    nothing_drives_forward(widths)
    assert min(width for t,
               width in widths if t > 0.1 + PULSE_DELAY_S
               + 0.02) >= NEUTRAL_US - NEUTRAL_TOLERANCE_US


def test_a_loop_that_holds_a_remnant_is_detected(monkeypatch):
    """Control: an integral that is left in force at a target of 0."""
    plain = SpeedLoop.throttle

    def leaking(self, speed, state, **how):
        return plain(self, speed, state, **how) + (0.05 if speed == 0.0 else 0.0)

    monkeypatch.setattr(SpeedLoop, "throttle", leaking)
    with pytest.raises(AssertionError):
        nothing_drives_forward(pulses(lambda t: 0.0))


def largest_pulse_after_failure(failure, seed):
    """(largest pulse before, after) a failure of the encoder at 3 s [us from neutral]."""
    backend = open_backend(f"sim://?nano=mock&seed={seed}&fail={failure}@3s")
    world = world_of(backend)
    widths = []
    world.watchers.append(lambda channel, pulse: widths.append(
        (pulse[1], (pulse[1] - pulse[0]) * 1e6 - NEUTRAL_US)) if channel == 1 else None)
    with Car.over(backend) as car:
        car.arm()
        begin = world.t
        for state in car.states(duration=5.0):
            applied = car.drive_speed(steering=0.0, speed=1.0)
        # The State has the reason, too.
        assert "ENCODER_DOUBTED" in applied.limited
        assert "ENCODER_DOUBTED" in state.applied.limited
    early = [us for t, us in widths if begin + 1.5 < t < 3.0]
    return max(early, default=0.0), max(us for t, us in widths if t > 3.0)


@pytest.mark.usefixtures("armed_esc")
@pytest.mark.parametrize("failure", ["enc:off", "enc:wrong=0.5"])
@pytest.mark.slow
def test_an_encoder_that_fails_is_no_reason_for_more_throttle(failure):
    for seed in (1, 2, 3, 4):
        before, after = largest_pulse_after_failure(failure, seed)
        assert after < 1.4 * before, seed


@pytest.mark.usefixtures("armed_esc")
@pytest.mark.slow
def test_control_a_loop_that_trusts_every_speed_gives_throttle(monkeypatch):
    monkeypatch.setattr(loop, "MAX_COASTING_DECELERATION", 1e9)
    found = [largest_pulse_after_failure("enc:wrong=0.5", seed) for seed in (1, 2)]
    assert all(after > 1.8 * before for before, after in found)
