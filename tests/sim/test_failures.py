"""Failures on a timetable: the words, the times, and what they do."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.wire.messages import STATE_FLAGS
from dart_lab.sim.failure_kinds import FAILURE_KINDS
from dart_lab.sim.failures import Failure, parse_failure


def flags(state):
    return {n for k, n in enumerate(STATE_FLAGS) if int(state["flags"]) & 1 << k}


@pytest.mark.parametrize(("text", "failure"), [
    ("imu:stuck@3.0s+1s", ("imu", "stuck", 3.0, None, 1.0)),
    ("imu:stuck@3 1", ("imu", "stuck", 3.0, None, 1.0)),
    ("pca:nack=3@0.5", ("pca", "nack", 0.5, 3.0, math.inf)),
])
def test_words(text, failure):
    target, kind, start, value, duration = failure
    got = parse_failure(text)
    assert (got.target, got.kind, got.start, got.duration) == (target, kind, start, duration)
    assert got.value == value or (value is None and math.isnan(got.value))


@pytest.mark.parametrize("text", ["imu", "imu:stuck", "imu:sulking@3", "cat:off@1", "imu:off@-1"])
def test_nonsense_lists_what_exists(text):
    with pytest.raises(UsageError) as caught:
        parse_failure(text)
    assert "imu:stuck" in caught.value.expected


def moving(raw_car, fail):
    return raw_car(f"sim://?nano=mock&fail={fail}").arm().drive(0.3, 0.3, 3.0)


@pytest.mark.slow
def test_imu_off_and_back(raw_car):
    states = moving(raw_car, "imu:off@3.0s+0.5s").states()
    valid = [("IMU_VALID" in flags(s)) for s in states]
    times = [s["t_ck"] for s in states]
    dark = [t for t, v in zip(times, valid, strict=True) if t > 1.0 and not v]
    assert min(dark) == pytest.approx(3.01, abs=0.02)
    assert max(dark) == pytest.approx(3.51, abs=0.02)


@pytest.mark.slow
def test_stuck_imu_is_called_stuck(raw_car):
    states = moving(raw_car, "imu:stuck@3").states()
    assert "IMU_STUCK" in flags(states[-1])
    assert not any("IMU_STUCK" in flags(s) for s in states if s["t_ck"] < 3.15)


def test_dead_encoder_keeps_its_count(raw_car):
    states = moving(raw_car, "enc:off@4+0.5").states()
    at = {round(s["t_ck"], 2): s["enc_count"] for s in states}
    by_time = sorted(at.items())
    dark = {c for t, c in by_time if 4.02 < t < 4.5}
    assert len(dark) == 1
    assert by_time[-1][1] > max(dark)


@pytest.mark.slow
def test_a_silent_line(raw_car):
    car = raw_car("sim://?nano=mock&fail=line:off@1+0.1").run(2.0)
    gaps = [b - a for a, b in pairwise(car.stamps)]
    assert max(gaps) == pytest.approx(0.11, abs=0.011)
    assert 8 <= car.decoder.counters.gaps <= 12


@pytest.mark.slow
def test_reset_of_the_nano(raw_car):
    car = moving(raw_car, "mcu:watchdog@4")
    boots = [f.as_dict()["boot_count"] for f in car.frames_named("HELLO")]
    assert boots == [1, 1, 1, 2, 2, 2]


def test_board_that_does_not_answer(raw_car):
    car = raw_car("sim://?nano=mock&fail=pca:nack@1+1").run(0.5)
    car.pulses(1500, 1500)
    car.run(1.0)
    with pytest.raises(OSError, match="Remote I/O"):
        car.pulses(1500, 1500)
    car.run(1.0)
    car.pulses(1500, 1500)


@pytest.mark.slow
def test_brown_out_of_the_board_ends_the_pulses(raw_car):
    car = moving(raw_car, "pca:brownout@4")
    assert car.world.esc.throttle == 0.0
    assert car.world.pca.peek(0xFE) == 0x1E


def test_what_the_mock_cannot_do_is_reported(raw_car):
    car = raw_car("sim://?nano=mock&fail=mcu:hang@0.1")
    with pytest.raises(UsageError, match="hang"):
        car.run(0.3)


@pytest.mark.emulator
@pytest.mark.parametrize("key", sorted(FAILURE_KINDS), ids=":".join)
@pytest.mark.slow_except("line:off", "mcu:brownout", "pca:off", "mcu:watchdog", "imu:zero")
def test_every_failure_acts_on_the_emulated_firmware(raw_car, key):
    car = raw_car(f"sim://?nano=avr&rc=1&fail={key[0]}:{key[1]}@0.6+0.2")
    car.run(1.0)
    assert len(car.frames_named("STATE")) > 50


def test_failure_values_are_frozen():
    with pytest.raises(AttributeError):
        Failure("imu", "off", 1.0).start = 2.0
