"""What is suggested does what it promises: driven by the hidden car, it names the truth."""

from __future__ import annotations

import pytest
from open_question import DRIVES as AT_HAND
from open_question import FLOOR, Case, diagnosis, gains, recorded

from dart_hal.diagnose.suggest import suggest
from dart_hal.diagnose.suggest.library import CHOICES, rehearsed

SAME = 6.0
"""Robust loss within which two effects are not told apart."""


@pytest.mark.parametrize(("case", "mocap"), [
    (Case("slow waves", ("steering_lag", 0.06), "steering_delay"), True),
    (Case("slow waves", ("steering_delay", 0.04), "steering_lag"), True),
    (Case("pulls", ("mass", 0.12), "motor_gain", ("motor.d", "motor.e", "friction.a")), True),
    (Case("straight", ("gyro_bias", 0.02), "steering_trim"), False),
    (Case("slow circles", ("front_grip", -0.15), "steering_gain"), True),
], ids=lambda p: p.truth[0] if isinstance(p, Case) else "")
@pytest.mark.more
def test_the_suggested_drive_tells_what_could_not_be_told(case, mocap, tmp_path):
    truth = case.truth[0]
    at_hand = recorded(tmp_path / "at_hand.csv", case, AT_HAND[case.drive], 5, mocap)
    before = gains(case, [at_hand])
    assert before[truth] - before[case.confounder] < SAME

    (s,) = suggest(diagnosis(case, [at_hand]))
    (pair,) = s.pairs
    assert s.enough
    assert pair.before < 4.0 <= pair.after
    assert pair.right > 0.95

    choices = tuple(c for c in CHOICES if c.name == s.drive)
    (drive,) = rehearsed(FLOOR, None, choices)
    with_mocap = s.needs == "motion capture"
    new = [recorded(tmp_path / f"{i}.csv", case, (c.throttle, c.steering), 80 + i, with_mocap)
           for i, c in enumerate(drive.commands)]
    if mocap and not with_mocap:
        at_hand = recorded(tmp_path / "at_hand.csv", case, AT_HAND[case.drive], 5, False)
    after = gains(case, [at_hand, *new])
    assert after[truth] - after[case.confounder] > 2.0 * SAME
    assert after[truth] == max(after.values())
