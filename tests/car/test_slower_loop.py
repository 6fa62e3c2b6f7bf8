"""``states(every=n)``: a slower loop on the stream of 100 Hz, whose commands hold in between."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dart_hal import Car
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Limit
from tests.common import MOCK_3_URL


def test_every_tenth_state_comes_at_10_hz():
    with Car.open(MOCK_3_URL) as car:
        list(car.states(duration=0.2))
        states = list(car.states(duration=1.0, every=10))
    assert [b.t - a.t for a, b in pairwise(states)] == pytest.approx([0.1] * 9, rel=0.01)
    assert states[-1].health.skipped == 0, "what was not requested is no loss"


@pytest.mark.slow
def test_a_replay_goes_on_in_the_same_steps_to_its_end(tmp_path):
    with Car.open(MOCK_3_URL, record=tmp_path / "run.mcap") as car:
        list(car.states(duration=1.0))
    with Car.open(f"replay://{tmp_path}/run.mcap") as car:
        all_of_it = [s.seq for s in car.states()]
    with Car.open(f"replay://{tmp_path}/run.mcap") as car:
        assert [s.seq for s in car.states(every=10)] == all_of_it[::10]


def applied_between(valid_for, every, rounds=8):
    """What States report of the pins while a loop of every n-th drives."""
    applied_commands = []
    with Car.open(MOCK_3_URL, raise_on_trip=False) as car:
        car.arm()
        car.drive(throttle=0.3, valid_for=0.5)
        list(car.states(duration=0.3))
        car.on_state(lambda state: applied_commands.append(state.applied))
        for state, _ in zip(car.states(every=every), range(rounds), strict=False):
            car.drive(throttle=0.3, valid_for=valid_for)
    return applied_commands[2:rounds * every - every]


@pytest.mark.parametrize(("every", "valid_for"), [(10, 0.2), (25, 0.5)])
@pytest.mark.slow
def test_a_command_holds_until_the_next_round(every, valid_for):
    for applied in applied_between(valid_for, every):
        assert applied.throttle > 0.25
        assert Limit.EXPIRED.value not in applied.limited


@pytest.mark.slow
def test_a_command_that_is_too_short_expires_between_two_rounds():
    """Negative control of the above: a slower loop does not stretch the validity of a command."""
    applied_commands = applied_between(0.05, 10)
    assert any(Limit.EXPIRED.value in applied.limited for applied in applied_commands)
    assert min(applied.throttle for applied in applied_commands) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("every", [0, -1, 26, 2.0, True, "10"])
def test_what_is_no_part_of_the_stream_is_refused(every):
    with Car.open(MOCK_3_URL) as car, pytest.raises(UsageError, match="every") as error:
        next(car.states(every=every))
    assert "0.5 s" in error.value.expected
