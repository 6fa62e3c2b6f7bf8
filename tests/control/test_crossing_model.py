"""Every order of events of a few cars: never two on the ground, always a way to the end; and the
protocol's parts, left out one at a time, let two of them on it."""

from __future__ import annotations

import pytest

from dart_hal.control.crossing import order
from dart_hal.control.crossing.order import CrossingPhase, Precedence
from studies.control.crossing_model import BEFORE, ON, PAST, Rules, check, put


class NoAcknowledgement(Rules):
    """Uses what it has received: a car that is not known to be before it does not count."""

    def may_go(self, car, j):
        return order.precedence(car, j) is not Precedence.AFTER or super().may_go(car, j)


class GrantWithoutStamp(Rules):
    """Any grant that was ever heard will do."""

    def may_go(self, car, j):
        other = car.others[j]
        after = order.precedence(car, j) is Precedence.AFTER
        return super().may_go(car, j) if after or other is None else other.grant > 0


class StampOfTheClockAlone(Rules):
    """Not above what it has heard."""

    def want(self, car, clock):
        if car.phase is not CrossingPhase.FREE or order.first_unaware(car) is not None:
            return car
        return car._replace(phase=CrossingPhase.WANT, ts=clock + 1)


class OneSession(Rules):
    """The second crossing needs no other car to know of it."""

    def again(self, car):
        new = super().again(car)
        return new._replace(boot=car.boot, seq=car.seq,
                            others=tuple(o and o._replace(heard=car.boot) for o in new.others))


class RequestsAtOnce(Rules):
    """A restarted car requests before all have confirmed its session."""

    def want(self, car, clock):
        others = tuple(o and o._replace(heard=car.boot) for o in car.others)
        known = tuple(
            o or order.OtherCar(0, 0, 0, CrossingPhase.FREE, 0, 0, 0, car.boot)
            if j != car.id
            else None
            for j, o in enumerate(others)
        )
        new = order.request(car._replace(others=known), clock)
        return car if new.phase is car.phase else new._replace(others=car.others)


class Forgets(Rules):
    """A car that restarts on the ground takes itself for one without a request."""

    def restarted(self, n, car, place, kept):
        phase = CrossingPhase.DONE if place == PAST else CrossingPhase.FREE
        return order.start_session(car.id, n, car.boot + 1, 0, place, phase)


class LosesItsStamp(Rules):
    """The disk is gone as well."""

    def restarted(self, n, car, place, kept):
        return super().restarted(n, car, place, 0)


class PassedOnBeginsASession(Rules):
    """What another car passes on is taken like what came late from its sender."""

    def passed(self, car, m):
        return order.receive(car, m)[0]


class PassedOnRevives(PassedOnBeginsASession):
    """And a session may be taken up again that another has followed."""

    def passed(self, car, m):
        other = car.others[m.id]
        if other is not None and other.boot != m.boot:
            others = put(car.others, m.id, other._replace(retired=()))
            car = car._replace(others=others)
        return super().passed(car, m)


@pytest.mark.parametrize(("n", "rounds", "restarts", "room"), [
    (2, 2, 0, 1), (2, 1, 0, 2), (2, 1, 1, 1),
    *(pytest.param(*case, marks=pytest.mark.long) for case in ((3, 1, 0, 0), (2, 2, 1, 1))),
], ids=str)
@pytest.mark.slow_except("2-2-0-1")
def test_no_order_of_events_is_unsafe_or_stuck(n, rounds, restarts, room):
    found = check(n, rounds, restarts, room)
    assert found.states > 5000
    assert found.unsafe is None
    assert found.stuck is None


@pytest.mark.slow
@pytest.mark.parametrize(("rounds", "restarts", "room"), [
    (1, 0, 0), (1, 0, 1), (1, 1, 0), pytest.param(2, 0, 0, marks=pytest.mark.long),
], ids=str)
@pytest.mark.long_except("1-0-1")
def test_nor_is_any_where_others_pass_messages_on_at_any_time(rounds, restarts, room):
    found = check(2, rounds, restarts, room, passed=True)
    assert found.states > 5000
    assert found.unsafe is None
    assert found.stuck is None


@pytest.mark.long
def test_a_session_begun_by_what_was_passed_on_is_waited_for_without_end():
    found = check(2, 1, 1, 0, rules=PassedOnBeginsASession(), passed=True)
    assert found.unsafe is None
    assert found.stuck is not None
    assert any(o.retired for car in found.stuck.cars for o in car.others if o is not None)


@pytest.mark.long
def test_with_one_taken_up_again_two_are_on_the_ground():
    found = check(2, 2, 0, 0, rules=PassedOnRevives(), passed=True)
    assert found.unsafe is not None
    assert found.unsafe.places.count(ON) == 2


@pytest.mark.parametrize(("mutant", "size"), [
    (NoAcknowledgement, (2, 1)), (GrantWithoutStamp, (2, 2)), (StampOfTheClockAlone, (2, 1)),
    (OneSession, (2, 2)), (RequestsAtOnce, (2, 1, 1)), (Forgets, (2, 1, 1)),
], ids=lambda v: v.__name__ if isinstance(v, type) else None)
@pytest.mark.slow_except("NoAcknowledgement-size0", "GrantWithoutStamp-size1",
                         "StampOfTheClockAlone-size2")
def test_without_each_of_its_parts_two_are_on_the_ground(mutant, size):
    found = check(*size, rules=mutant())
    assert found.unsafe is not None
    assert found.unsafe.places.count(ON) == 2


@pytest.mark.slow
def test_a_car_that_lost_its_stamp_on_the_ground_is_safe_but_stays():
    found = check(2, 1, 1, rules=LosesItsStamp())
    assert found.unsafe is None
    assert found.stuck is not None
    assert any(car.phase is CrossingPhase.BACK for car in found.stuck.cars)
    assert BEFORE in found.stuck.places
