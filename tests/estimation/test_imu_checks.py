"""Which samples of an IMU are believed: laws of the checks, sample by sample."""

from __future__ import annotations

import random
from math import tan

import pytest

from dart_hal.estimation.imu_checks import (
    MAX_TURN_RATE,
    MIN_DISAGREEMENT_TIME,
    MIN_GOOD_SAMPLES,
    ImuCheck,
)

CAR_WHEELBASE = 0.175
STILL = ((0.001, 0.0, 0.002), (0.01, 0.02, 0.0))
CHECK_PERIOD = 0.01


class Stream:
    """Samples one after the other into one check, 100 a second."""

    def __init__(self) -> None:
        self.check = ImuCheck(CAR_WHEELBASE)
        self.n = 0

    def feed(self, gyro, acc=STILL[1], speed=0.0, steering=0.0) -> bool:
        self.n += 1
        t = self.n * CHECK_PERIOD
        return self.check.judge(t, t - 0.006, gyro, acc, gyro[2] if gyro else 0.0, speed, steering)

    def still(self, n: int) -> list[bool]:
        return [self.feed(*STILL) for _ in range(n)]


@pytest.fixture
def stream() -> Stream:
    made = Stream()
    assert all(made.still(20))
    return made


def test_what_the_nano_does_not_vouch_for_is_not_doubted(stream):
    assert not stream.feed(None, None)
    assert not stream.check.doubts
    assert stream.feed(*STILL), "a pause alone costs nothing"


@pytest.mark.parametrize(("gyro", "acc", "name"), [
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "IMU_ZERO"),
    ((0.0, 0.0, MAX_TURN_RATE + 0.1), STILL[1], "IMU_RANGE"),
    ((0.0, -20.0, 0.0), STILL[1], "IMU_RANGE"),
    (STILL[0], (0.0, 60.0, 0.0), "IMU_RANGE"),
    ((0.0, 0.0, 4.0), STILL[1], "IMU_STEP"),
])
def test_an_impossible_sample_is_named_and_some_good_ones_are_required_after_it(
        stream, gyro, acc, name):
    assert not stream.feed(gyro, acc)
    assert stream.check.doubts == {name}
    trusted = stream.still(MIN_GOOD_SAMPLES + 3)
    first = trusted.index(True)
    assert first in (MIN_GOOD_SAMPLES - 1, MIN_GOOD_SAMPLES), "a step back is a step as well"
    assert all(trusted[first:])
    assert not stream.check.doubts


def test_the_same_sample_twice_is_no_second_look(stream):
    """Frames come faster than samples now and then: nothing is regained by repeating one."""
    stream.feed((0.0, 0.0, 20.0))
    t = stream.n * CHECK_PERIOD - 0.006
    for _ in range(20):
        stream.n += 1
        assert not stream.check.judge(stream.n * CHECK_PERIOD, t, *STILL, STILL[0][2], 0.0, 0.0)


@pytest.mark.slow
def test_random_words_are_never_believed():
    """1e5 samples of six random words: none is given out."""
    stream = Stream()
    rng = random.Random(1)
    stream.still(10)
    for _ in range(100_000):
        words = [rng.randrange(-32768, 32768) for _ in range(6)]
        assert not stream.feed(tuple(w / 900.0 for w in words[3:]),
                               tuple(w * 0.01 for w in words[:3]))


def turns(stream: Stream, rate, speed: float, steering: float, seconds: float,
          aside: float | None = None) -> list[str]:
    """Doubts at the end of a bend that the gyro measures as ``rate``; reached in half a second."""
    for k in range(int((seconds + 0.5) / CHECK_PERIOD)):
        w = rate * min(k * CHECK_PERIOD / 0.5, 1.0)
        accel = speed * (w if aside is None else aside)
        stream.feed((0.0, 0.0, w), (0.01, accel + 0.001, 0.0), speed, steering)
    return sorted(stream.check.doubts)


def bend(speed: float, steering: float) -> float:
    return speed * tan(steering) / CAR_WHEELBASE


@pytest.mark.parametrize(("share", "doubts"), [
    (1.0, []), (0.8, []), (1.2, []), (-1.0, ["IMU_DISAGREES"]), (2.5, ["IMU_DISAGREES"]),
    (0.0, ["IMU_DISAGREES"])])
def test_a_slow_bend_must_agree_with_the_wheels(stream, share, doubts):
    assert turns(stream, share * bend(0.5, 0.3), 0.5, 0.3, 1.0) == doubts


@pytest.mark.parametrize(("share", "doubts"), [
    (1.0, []), (0.4, []), (0.0, []), (2.5, ["CAR_SLIDES"]), (-1.0, ["CAR_SLIDES"])])
def test_a_fast_bend_may_understeer_and_a_spin_is_believed(stream, share, doubts):
    assert turns(stream, share * bend(1.5, 0.3), 1.5, 0.3, 1.0) == doubts
    assert stream.check.trusted


def test_in_a_fast_bend_the_lateral_acceleration_decides(stream):
    """A gyro that turns the other way, while the car is measured to go round as it steers."""
    rate = bend(1.0, 0.25)
    assert turns(stream, -rate, 1.0, 0.25, 1.0, aside=rate) == ["IMU_DISAGREES"]
    assert not stream.check.trusted


def test_a_short_disagreement_is_none(stream):
    assert turns(stream, bend(0.5, 0.3), 0.5, 0.3, 1.0) == []
    for k in range(int(0.9 * MIN_DISAGREEMENT_TIME / CHECK_PERIOD)):
        assert stream.feed((0.0, 0.0, bend(0.5, 0.3) - 1.2 * min(k, 1)), STILL[1], 0.5, 0.3)
