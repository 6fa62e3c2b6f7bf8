"""Cars that share their plans: no two committed plans come near, even if messages are lost, and
without the acknowledgement they do."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from math import inf

import numpy as np
import pytest

from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.control.paths import Path
from dart_hal.control.shared_plans import search
from dart_hal.control.shared_plans.message import MAX_CARS, PlanMessage, decode, encode
from dart_hal.control.shared_plans.planner import PlanSharer, PlanVerdict
from dart_hal.control.shared_plans.search import comparison_times, find_plan, score
from dart_hal.control.shared_plans.space import PlanSpace
from dart_hal.control.shared_plans.timed_plan import (
    MAX_KNOTS,
    TimedPlan,
    arc_lengths,
    cut_before,
    motion_at,
    replace_after,
    rest_plan,
)
from dart_hal.core.errors import UsageError
from studies.control import distributed_light as cars
from studies.control.crossing_fleet import example
from studies.control.distributed_central import optimise
from studies.control.distributed_plans import (
    SHORT_HORIZON,
    HastySharer,
    arrivals,
    rest_anywhere,
)

PERIOD = 0.05
GO = TimedPlan(0, 2.0, 1.0, (0, 1, 2, 3, 3, 2, 1, 0))


@cache
def cross(count=4):
    """Straight paths of 6 m that meet in the middle, at equal angles."""
    angles = np.pi * np.arange(count) / count + 0.3
    return PlanSpace([[Path([(6.0, 0.0)], closed=False, start=(
        -3.0 * np.cos(a), -3.0 * np.sin(a), a))] for a in angles.tolist()])


def exchange(make, seed, loss, seconds=8.0, delay=0.3, space=None):
    """Cars whose messages are lost, late and overtake each other: the least distance of any two
    committed plans from the moment on at which either was adopted, and the cars."""
    space = space or cross()
    rng = np.random.default_rng(seed)
    n = len(space.paths)
    sharers = [make(space, i, 0.0, 1 + i) for i in range(n)]
    under_way = []
    least = inf
    plans = [None] * n
    for k in range(round(seconds / PERIOD)):
        t = k * PERIOD
        due = [w for w in under_way if w[0] <= t]
        under_way = [w for w in under_way if w[0] > t]
        for _, sent_t, j, data in due:
            sharers[j].receive(data, t, t - sent_t)
        for i in rng.permutation(n):
            sharers[i].step(t)
            data = sharers[i].next_message(t)
            under_way += [(t + rng.uniform(0.0, delay), t, j, data) for j in range(n)
                          for _ in range(1 + (rng.random() < 0.1))
                          if j != i and rng.random() >= loss]
        now = [s.committed for s in sharers]
        for i, j in combinations(range(n), 2):
            if now[i] is not plans[i] or now[j] is not plans[j]:
                least = min(least, space.distance(i, now[i], j, now[j], t))
        plans = now
    return least, sharers


@pytest.mark.parametrize(("seed", "loss"), [(1, 0.0), (2, 0.5), (3, 0.8), (4, 0.8)])
@pytest.mark.slow
def test_committed_plans_keep_the_distance_though_messages_are_lost(seed, loss):
    least, sharers = exchange(PlanSharer, seed, loss)
    assert least >= cross().min_distance - 1e-3
    if loss <= 0.5:
        assert all(s.committed.end_s > 5.0 for s in sharers), "all have a plan to the end"


@pytest.mark.slow
def test_plans_that_are_adopted_without_acknowledgement_meet():
    """The negative control: with the rule, the same messages cause no contact."""
    assert exchange(HastySharer, 2, 0.5, 3.0)[0] < 0.2
    assert exchange(PlanSharer, 2, 0.5, 3.0)[0] >= cross().min_distance - 1e-3


@pytest.mark.slow
def test_plans_that_may_end_on_the_paths_of_others_block_each_other(monkeypatch):
    """The second control, with plans of 3 s: with the rule all of them get to the end."""
    monkeypatch.setattr(search, "HORIZON_KNOTS", SHORT_HORIZON)
    anywhere = rest_anywhere(PlanSpace(cross().paths))
    for space, is_blocked in ((anywhere, True), (cross(), False)):
        least, sharers = exchange(PlanSharer, 1, 0.0, 7.0, 0.05, space)
        assert least >= space.min_distance - 1e-3
        assert any(s.committed.end_s < 4.0 for s in sharers) == is_blocked


def test_without_any_message_all_cars_stay():
    _, sharers = exchange(PlanSharer, 1, 1.0, 3.0)
    assert all(s.committed == rest_plan(0, 0.0, 0.0) for s in sharers)
    assert sharers[0].counts["EXPIRED"] > 0


def test_a_car_that_restarts_is_refused_and_the_others_keep_away():
    space = cross(2)
    a, b = (PlanSharer(space, i, 0.0, 1 + i) for i in range(2))
    for k in range(20):
        t = k * PERIOD
        for sender, receiver in ((a, b), (b, a)):
            sender.step(t)
            receiver.receive(sender.next_message(t), t, 0.0)
    assert a.counts["ADOPTED"]
    again = PlanSharer(space, 0, 0.0, 77, t)
    again.step(t)
    assert b.receive(again.next_message(t), t, 0.0) is PlanVerdict.RETIRED
    again.receive(b.next_message(t), t, 0.0)
    again.step(t + PERIOD)
    assert not again.is_acknowledged()
    assert again.counts["ADOPTED"] == 0


def test_a_withdrawn_proposal_is_never_adopted():
    space = cross(2)
    a, b = (PlanSharer(space, i, 0.0, 1 + i) for i in range(2))
    a.step(0.0)
    b.receive(a.next_message(0.0), 0.0, 0.0)
    acknowledgement = b.next_message(0.0)
    a.step(2.0)  # after the branch time: it expires, and another one is proposed
    a.receive(acknowledgement, 2.0, 2.0)
    a.step(2.05)
    assert a.counts["EXPIRED"] == 1
    assert a.counts["ADOPTED"] == 0


def test_start_on_the_path_of_another_car_is_refused():
    with pytest.raises(UsageError, match="starts on a path of another car"):
        PlanSharer(cross(), 0, 3.0, 1)


# -- plans ---------------------------------------------------------------------------------------

def test_plan_is_integrated_exactly_and_ends_at_rest():
    times = np.linspace(1.5, 5.0, 3501)
    s = arc_lengths(GO, times)
    speeds = np.array([motion_at(GO, float(t))[1] for t in times])
    assert s[0] == 1.0
    assert np.abs(np.gradient(s, times) - speeds)[1:-1].max() < 1e-3
    assert s[-1] == pytest.approx(GO.end_s)
    assert motion_at(GO, GO.end_t + 9.0) == (pytest.approx(GO.end_s), 0.0, 0.0)


@pytest.mark.parametrize("t", [0.0, 2.1, 2.6, 3.75, 9.1])
def test_a_plan_that_is_cut_is_the_same_later(t):
    times = np.linspace(t, 12.0, 100)
    cut = cut_before(GO, t)
    assert cut.t <= max(t, GO.t)
    assert np.allclose(arc_lengths(cut, times), arc_lengths(GO, times))


def test_a_plan_is_the_same_until_its_branch():
    new = replace_after(GO, 3, 0, (3, 4, 3, 2, 1, 0))
    times = np.linspace(GO.t, GO.t + 0.75, 50)
    assert np.allclose(arc_lengths(new, times), arc_lengths(GO, times))
    assert new.end_s > GO.end_s


def test_search_finds_the_best_plan_alone_and_goes_behind_a_car_that_crosses():
    space = cross(2)
    path, rests = space.paths[0][0], space.rests[0][0]
    alone = find_plan(path, rests, 0.0, 0, [], space.min_distance)
    plan = TimedPlan(0, 0.0, 0.0, alone.levels)
    assert plan.end_s == pytest.approx(5.9)
    assert score(plan) == pytest.approx(alone.score, abs=0.01)
    assert max(alone.levels) == 5
    other = space.positions(1, plan, comparison_times(0.0))
    second = find_plan(path, rests, 0.0, 0, [other], space.min_distance)
    behind = TimedPlan(0, 0.0, 0.0, second.levels)
    assert second.score < alone.score
    assert space.distance(0, behind, 1, plan, 0.0) >= space.min_distance
    blocked = space.positions(1, rest_plan(0, 0.0, 3.0), comparison_times(0.0))
    waiting = find_plan(path, rests, 0.0, 0, [blocked], space.min_distance)
    assert TimedPlan(0, 0.0, 0.0, waiting.levels).end_s < 3.0 - space.min_distance


# -- messages ------------------------------------------------------------------------------------

def message(n=MAX_CARS, levels=(0, 1, 2, 1, 0)):
    return PlanMessage(1, 7, 9, 3, TimedPlan(0, -0.25, 1.5, levels), 4,
                       TimedPlan(0, 0.5, 1.5, levels), 2.5, tuple(range(n)), tuple(range(n)))


def test_message_is_decoded_as_it_was_encoded_and_fits_the_room():
    longest = (*((0, 1) * (MAX_KNOTS // 2 - 1)), 0, 0)
    for m in (message(), message(2)._replace(proposal=None), message(levels=longest)):
        data = encode(m, 5)
        assert decode(data, 5) == m
        assert len(data) <= 255
        assert decode(data, 6) is None
        assert all(decode(data[:k], 5) is None for k in range(len(data)))


def test_damaged_messages_are_refused_or_are_plans_that_can_be_driven():
    rng = np.random.default_rng(1)
    data = bytearray(encode(message(3), 5))
    sharer = PlanSharer(cross(), 0, 0.0, 1)
    for _ in range(300):
        damaged = bytearray(data)
        for k in rng.integers(0, len(data), 3):
            damaged[k] = int(rng.integers(0, 256))
        found = decode(bytes(damaged), 5)
        assert found is None or found.committed.levels[-1] == 0
        assert sharer.receive(bytes(damaged), 0.0, 0.0) is PlanVerdict.INVALID


def test_too_many_cars_are_refused():
    with pytest.raises(UsageError, match="too many cars"):
        encode(message(MAX_CARS + 1), 5)


# -- on the light simulation ---------------------------------------------------------------------

@pytest.mark.slow
def test_four_cars_cross_in_time_though_half_of_the_messages_are_lost():
    drawn = arrivals("intersection", 2, 500)
    for arrival, outcome in zip(drawn, cars.drive(drawn, 0.5), strict=True):
        central = optimise(arrival)
        assert outcome.contacts == 0
        assert outcome.least > 0.36
        assert central.alone <= central.mean
        assert np.mean(outcome.passed) < 1.3 * central.mean


@pytest.mark.parametrize(("place", "meet"), [
    ("intersection", True), ("merge", True), ("open", False)])
@pytest.mark.slow
@pytest.mark.long_except("intersection-True", "open-False")
def test_arrivals(place, meet):
    """In the open space cars hardly meet, so nothing collides without acknowledgements either."""
    drawn = arrivals(place, 10, 520)
    for loss in (0.0, 0.5):
        driven = cars.drive(drawn, loss)
        assert sum(o.contacts for o in driven) == 0
        assert max(max(o.passed) for o in driven) < 15.0
        assert max(o.stalled for o in driven) < 5.0
    contacts = sum(o.contacts for o in cars.drive(drawn, 0.5, make=HastySharer))
    assert (contacts > 0) == meet, "the control"


@pytest.mark.slow
def test_two_emulated_cars_cross_by_their_plans(monkeypatch):
    program = example()
    monkeypatch.setattr(program, "ROUTES", (("S-N", 1.2), ("E-W", 1.2)))
    rows, crossers, contacts = program.drive(
        LAYOUTS["intersection"](), "plans", make=program.plan_crossers)
    assert program.figures(rows)[0] > 0.38
    assert len(contacts) == 0
    assert all(c.is_done and not c.why and c.deviation < 0.12 for c in crossers)
    assert all(c.log_values["adopted"] >= 1.0 for c in crossers)
