"""Emulated cars at an intersection: who waits has neutral at its ESC, without contact."""

from __future__ import annotations

from math import inf

import pytest

from dart_hal.control.crossing.coordinator import Coordinator, CrossingWait, StopLine
from dart_hal.control.crossing.layouts import LAYOUTS
from studies.control.crossing_fleet import Emulated, Fault

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
