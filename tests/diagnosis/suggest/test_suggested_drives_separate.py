"""What is suggested does what it promises: driven by the hidden car, it names the truth."""

from __future__ import annotations

from functools import cache
from statistics import mean

import pytest

from dart_lab.diagnosis.suggest import suggest
from dart_lab.diagnosis.suggest.library import CHOICES, rehearse_choices
from tests.diagnosis.suggest.open_question import DRIVE_COMMANDS as AT_HAND
from tests.diagnosis.suggest.open_question import (
    LARGE_FLOOR,
    QuestionCase,
    diagnosis,
    gains,
    record_case,
)

pytestmark = pytest.mark.slow

SAME = 6.0
"""Robust loss within which two effects are not distinguished."""
DRIVE_DRAWS = 3
"""Of the noise: the margin of one draw varies by a half."""
QUESTIONS = {
    "steering_lag": (QuestionCase("slow waves", ("steering_lag", 0.06), "steering_delay"), True),
    "steering_delay": (QuestionCase("slow waves", ("steering_delay", 0.04), "steering_lag"), True),
    "mass": (QuestionCase("pulls", ("mass", 0.12), "motor_gain",
                          ("motor.d", "motor.e", "friction.a")),
             True),
    "gyro_bias": (QuestionCase("straight", ("gyro_bias", 0.02), "steering_trim"), False),
    "front_grip": (QuestionCase("slow circles", ("front_grip", -0.15), "steering_gain"), True),
}


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """By the name of a case: the promise, and the gains of each draw of what was suggested."""

    @cache
    def make_question(name):
        case, mocap = QUESTIONS[name]
        folder = tmp_path_factory.mktemp(name)
        at_hand = record_case(folder / "at_hand.csv", case, AT_HAND[case.drive], 5, mocap)
        before = gains(case, [at_hand])
        assert before[name] - before[case.confounder] < SAME
        (s,) = suggest(diagnosis(case, [at_hand]))
        choices = tuple(c for c in CHOICES if c.name == s.drive)
        (drive,) = rehearse_choices(LARGE_FLOOR, None, choices)
        with_mocap = s.needs == "motion capture"
        if mocap and not with_mocap:
            at_hand = record_case(folder / "at_hand.csv", case, AT_HAND[case.drive], 5, False)
        return s, [gains(case, [at_hand, *(
            record_case(folder / f"{draw}-{i}.csv", case, (c.throttle, c.steering),
                        80 + 10 * draw + i, with_mocap) for i, c in enumerate(drive.commands))])
            for draw in range(DRIVE_DRAWS)]

    return make_question


@pytest.mark.parametrize("name", QUESTIONS)
def test_the_suggested_drive_separates_what_was_confounded(name, driven):
    s, drawn = driven(name)
    (pair,) = s.pairs
    assert s.enough
    assert pair.before < 4.0 <= pair.after
    assert pair.right > 0.95
    assert all(gained[name] == max(gained.values()) for gained in drawn)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.xfail(
    strict=True, reason="promised 6.1 standard deviations, 37 of loss, for the rollouts with a "
    "full and a half empty battery; found 10 to 13 in the mean of draws"))
    if n == "mass" else n for n in QUESTIONS])
@pytest.mark.long_except("front_grip")
def test_by_a_clear_margin(name, driven):
    _, drawn = driven(name)
    confounder = QUESTIONS[name][0].confounder
    assert mean(gained[name] - gained[confounder] for gained in drawn) > 2.0 * SAME
