"""Emulated cars at an intersection: who waits has neutral at its ESC, without contact."""

from __future__ import annotations

from itertools import pairwise
from math import inf

import numpy as np
import pytest

from dart_hal.control.crossing import plan_crosser
from dart_hal.control.crossing.coordinator import Coordinator, CrossingWait, StopLine
from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.control.crossing.plan_crosser import PlanCrosser, PlanWait
from studies.control.crossing_fleet import Emulated, Fault

pytestmark = pytest.mark.usefixtures("armed_esc")

ROUTES = (("S-N", 1.2), ("E-W", 1.2))
MEET = (("S-N", 1.7), ("E-W", 1.2))


@pytest.mark.slow
def test_two_emulated_cars_cross_one_after_the_other(tmp_path):
    room = "local://two?loss=0.5&delay=0.01&jitter=0.04&seed=3"
    with Emulated(LAYOUTS["intersection"](), ROUTES, room, str(tmp_path), "two") as cars:
        cars.drive(15.0)
        assert cars.least > 0.35
        assert max(cars.across) < 12.0
        assert cars.fleet.contacts == ()
        assert any(CrossingWait.FOR_CAR in waits for _, _, waits, _ in cars.rows)


@pytest.mark.slow
def test_a_car_without_an_answer_waits_before_the_ground_at_neutral(tmp_path):
    with Emulated(LAYOUTS["intersection"](), ROUTES, "local://none?loss=1", str(tmp_path),
                  "none") as cars:
        cars.drive(8.0)
        entry = cars.layout.entry[0]
        assert cars.across == [inf, inf]
        assert all(entry - 0.25 < mind.s < entry + 0.03 for mind in cars.minds)
        assert all(mind.last.wait is CrossingWait.SILENT for mind in cars.minds)
        stood = cars.rows[-100][3]
        for n, world in enumerate(cars.worlds):
            assert cars.driving(n, stood[n], world.t) == 0, "the last second at the pin"
            assert cars.driving(n, 0.0, stood[n]) > 10, "control: it drove there"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["dead", "mute", "restart", "lost"])
@pytest.mark.long_except("dead", "restart")
def test_a_car_with_a_fault_amid_the_ground_is_never_met(kind, tmp_path):
    """The fault is of the car that goes first, on its way across."""
    room = "local://fault?loss=0.5&delay=0.01&jitter=0.04&seed=3"
    with Emulated(LAYOUTS["intersection"](), ROUTES, room, str(tmp_path), "fault") as cars:
        cars.drive(10.0, Fault(kind, 0, 1.8))
        assert cars.least > 0.35
        assert cars.fleet.contacts == ()
        assert (cars.across[1] < inf) == (kind == "restart"), "with its stamp it goes on"
        assert (cars.across[0] < inf) == (kind in ("restart", "mute"))
        assert (cars.minds[0].last.wait is CrossingWait.STRANDED) == (kind == "lost")
        if kind != "restart":  # the other waits before what the first may want, at neutral
            stood, end = (cars.rows[n][3][1] for n in (-200, -1))
            assert cars.minds[1].last.wait is (
                CrossingWait.FOR_CAR if kind == "lost" else CrossingWait.SILENT
            )
            assert cars.driving(1, stood, end) == 0, "the last two seconds at the pin"
            assert cars.driving(1, 0.0, stood) > 10, "control: it drove there"


@pytest.mark.slow
def test_without_the_order_two_cars_touch(monkeypatch, tmp_path):
    monkeypatch.setattr(Coordinator, "step", lambda *_: StopLine(inf, CrossingWait.GOING, ""))
    with Emulated(LAYOUTS["intersection"](), MEET, "local://none", str(tmp_path),
                  "touch") as cars:
        cars.drive(8.0)
        assert cars.least < 0.35


# -- cars that share their plans ------------------------------------------------------------------

def drive_by_plans(folder, loss, seconds):
    """Two emulated cars that share their plans, as driven."""
    room = f"local://plans?loss={loss:g}&delay=0.01&jitter=0.04&seed=3"
    folder.mkdir(exist_ok=True)
    with Emulated(LAYOUTS["intersection"](), ROUTES, room, str(folder), "plans",
                  by_plans=True) as cars:
        cars.drive(seconds)
    return cars


def driven_while(cars, n, wait, settling=0.6):
    """Whether each pulse at the ESC of car n is not neutral, in a state that lasts ``settling`` s.
    """
    since, times = 0.0, []
    for before, row in pairwise(cars.rows):
        since = row[3][n] if row[2][n] is not before[2][n] else since
        if row[2][n] is wait and row[3][n] > since + settling:
            times.append((before[3][n], row[3][n]))
    return [cars.driving(n, *span) > 0 for span in times]


@pytest.mark.slow
def test_cars_that_share_plans_drive_while_they_pass_though_messages_are_lost(tmp_path):
    cars = drive_by_plans(tmp_path, 0.5, 12.0)
    assert max(cars.across) < inf
    assert cars.fleet.contacts == ()
    for n in range(2):
        assert np.mean(driven_while(cars, n, PlanWait.GOING)) > 0.3


@pytest.mark.slow
def test_a_car_that_leaves_its_plan_stops_at_neutral(tmp_path, monkeypatch):
    monkeypatch.setattr(plan_crosser, "MAX_DEVIATION", 0.01)
    cars = drive_by_plans(tmp_path, 0.5, 4.0)
    stood, end = cars.rows[-100][3], cars.rows[-1][3]
    for n, mind in enumerate(cars.minds):
        assert "from the plan that was shared" in mind.why
        assert cars.driving(n, stood[n], end[n]) == 0, "the last second at the pin"
        assert cars.driving(n, 0.0, stood[n]) > 10, "control: it drove there"


@pytest.mark.slow
def test_without_any_message_cars_that_share_plans_stay_at_neutral(tmp_path, monkeypatch):
    cars = drive_by_plans(tmp_path, 1.0, 3.0)
    for n in range(2):
        waited = driven_while(cars, n, PlanWait.WAITING)
        assert len(waited) > 100
        assert not any(waited)
    follow_plan = PlanCrosser._follow_plan
    monkeypatch.setattr(PlanCrosser, "_follow_plan", lambda self, t: follow_plan(self, t) or 0.4)
    assert any(driven_while(drive_by_plans(tmp_path / "rolls", 1.0, 3.0), 0, PlanWait.WAITING)), (
        "control: a car in the state of waiting that rolls")
