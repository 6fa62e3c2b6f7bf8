"""What every car does, real time or virtual, firmware or mock: one suite for all."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from dart_hal.core.errors import BadCommand

ALL_NANOS = ["mock", pytest.param("avr", marks=pytest.mark.emulator),
             pytest.param("pty", marks=[pytest.mark.realtime, pytest.mark.slow])]
NEUTRAL_RANGE = range(305, 309)
"""Counts of 4.88 us around the neutral of 1500 us."""
every_car = pytest.mark.parametrize("bench", ALL_NANOS, indirect=True)
every_car_in_time = pytest.mark.parametrize(
    "bench", [*ALL_NANOS[:2], pytest.param("pty", marks=[pytest.mark.realtime, pytest.mark.long])],
    indirect=True)
"""The same; the served car in the long suite alone."""


@every_car
def test_states_go_forward(bench):
    states = list(bench.car.states(duration=0.5, timeout=30.0))
    assert len(states) > 2
    assert all(b.t > a.t and b.seq > a.seq for a, b in pairwise(states))
    if bench.virtual:
        assert len(states) == 50
        assert states[-1].t - states[0].t == pytest.approx(0.49, abs=1e-3)


@every_car
def test_disarmed_it_carries_neutral_and_reports_it(bench):
    bench.car.stop()
    for _ in bench.car.states(duration=0.1, timeout=30.0):
        applied = bench.car.drive(steering=0.2, throttle=0.5)
    assert applied.throttle == 0.0
    assert "NOT_ARMED" in applied.limited
    assert bench.counts()[1] in NEUTRAL_RANGE


@every_car
@pytest.mark.slow_except("mock", "pty")
def test_left_circle_gives_positive_yaw_and_y(bench):
    car = bench.ready()
    first = next(car.states())
    for state in car.states(duration=2.5, timeout=30.0):
        car.drive_speed(steering=0.25, speed=0.6)
    assert state.speed > 0.3
    assert state.yaw_rate > 0.3
    turned = state.pose.yaw - first.pose.yaw
    dx = state.pose.x - first.pose.x
    dy = state.pose.y - first.pose.y
    assert turned > 0.3
    assert -math.sin(first.pose.yaw) * dx + math.cos(first.pose.yaw) * dy > 0.05
    assert state.ticks > first.ticks
    assert bench.counts()[0] > 307


@every_car_in_time
@pytest.mark.slow
def test_a_right_turn_gives_negative_yaw(bench):
    car = bench.ready()
    first = next(car.states())
    for state in car.states(duration=1.5, timeout=30.0):
        car.drive_speed(steering=-0.25, speed=0.6)
    assert state.pose.yaw - first.pose.yaw < -0.05


@pytest.mark.slow_except("avr")
@every_car
def test_an_expired_command_is_neutral_and_a_trip(bench):
    car = bench.ready()
    until = {"t": math.inf}

    def is_expired(state):
        if state.applied.throttle > 0.1:
            until["t"] = min(until["t"], state.t)
        return math.isfinite(until["t"]) and state.applied.throttle == 0.0

    car.drive(throttle=0.3, valid_for=0.1)
    states = bench.until(is_expired)
    assert bench.counts()[1] in NEUTRAL_RANGE
    assert "COMMAND_EXPIRED" in car.causes or not bench.virtual
    assert car.mode in ("TRIPPED", "LOCKED", "DISARMED")
    if bench.virtual:
        assert states[-1].t - until["t"] <= 0.1 + 0.03
        assert "EXPIRED" in states[-1].applied.limited


@pytest.mark.slow_except("mock")
@every_car_in_time
def test_a_command_that_is_renewed_does_not_expire(bench):
    """The control of the test above."""
    car = bench.ready()
    for state in car.states(duration=0.6, timeout=30.0):
        car.drive(throttle=0.2, valid_for=0.5)
    assert car.mode == "ARMED"
    assert state.applied.throttle > 0.1


@pytest.mark.slow
@every_car
def test_a_repeated_command_is_sent_again(bench, monkeypatch):
    """Another hand, or a brown-out, changes the register: the same command heals it."""
    car = bench.ready()
    foreign = bytes((0x06, 0, 0, 200, 0, 0, 0, 200, 0))
    after = []
    # in real time the read-back may see the strange pulse before it is healed
    monkeypatch.setattr(car, "raise_on_trip", bench.virtual)
    counters = car._engine.driver.actuator.counters
    checked = counters.read_backs
    written = False
    for _ in car.states(duration=2.0, timeout=30.0):
        car.drive(steering=0.1, throttle=0.2, valid_for=0.5)
        if written:
            after.append(bench.counts())
        elif counters.read_backs > checked:  # the next one is a second away
            bench.bus.writeto(0x40, foreign)
            written = True
            assert bench.counts() == (200, 200) or not bench.virtual
        if len(after) == 40:
            break
    # in real time a busy machine may stall the loop, and then the throttle is neutral, as it must
    healed = [s > 307 and 315 < t < 340 for s, t in after]
    if bench.virtual:
        assert healed[-1]
    else:
        assert any(healed) or "PCA_READBACK" in car.causes
        neutral = [abs(t - 307) <= 3 for _, t in after]
        assert all(well or still for well, still in zip(healed[1:], neutral[1:], strict=True))
        assert neutral[-1] or car.mode == "ARMED"
    assert (200, 200) not in after[1:]


@pytest.mark.slow_except("avr")
@every_car
def test_stop_is_neutral_at_once_and_holds_the_steering(bench):
    car = bench.ready()
    for _ in car.states(duration=0.2, timeout=30.0):
        car.drive(steering=0.2, throttle=0.2, valid_for=0.5)
    before = bench.counts()
    applied = car.stop()
    after = bench.counts()
    assert applied.throttle == 0.0
    assert after[1] in NEUTRAL_RANGE
    assert abs(after[0] - before[0]) <= 1
    assert before[1] > 312
    assert car.mode == "DISARMED"


@pytest.mark.slow_except("bad0-mock")
@every_car
@pytest.mark.parametrize("bad", [{"throttle": math.nan}, pytest.param(
    {"steering": math.inf}, marks=pytest.mark.long)])
def test_a_command_that_is_no_number_trips(bench, bad, monkeypatch):
    car = bench.ready()
    monkeypatch.setattr(car, "raise_on_trip", False)
    for _ in car.states(duration=0.1, timeout=30.0):
        car.drive(throttle=0.2, valid_for=0.5)
    with pytest.raises(BadCommand, match="not a number"):
        car.drive(**{"throttle": 0.2, **bad})
    assert bench.counts()[1] in NEUTRAL_RANGE
    for _ in car.states(duration=0.1, timeout=30.0):
        applied = car.drive(throttle=0.2)
    assert applied.throttle == 0.0, "a good command after it does not undo the trip"
    assert car.mode in ("TRIPPED", "LOCKED", "DISARMED")
    assert "COMMAND_INVALID" in car.causes


@pytest.mark.slow
@every_car
def test_what_is_out_of_range_is_clipped_and_reported(bench):
    car = bench.ready()
    limits = car.files.config.limits
    next(car.states(timeout=30.0))
    applied = car.drive(steering=9.0, throttle=0.1)
    car.stop()
    assert "RANGE" in applied.limited
    assert 0.2 < applied.steering <= limits.max_steering + 0.01
    good = car.drive(steering=0.1, throttle=0.0)
    assert "RANGE" not in good.limited
