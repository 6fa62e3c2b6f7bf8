"""A loop that is too slow for a car: counted by the wall clock, reported once at the end, in
virtual time too."""

from __future__ import annotations

import contextlib
import logging
import math
import time

import pytest

from dart_hal.car import Car
from dart_hal.car.timing import LoopTimer
from dart_hal.cli.main import main
from dart_hal.core.errors import Disarmed, UsageError
from dart_hal.core.ports import Chunk, Link
from dart_hal.core.timing import SAMPLE
from dart_hal.devices.links.base import open_backend
from dart_hal.devices.links.paced import PacedLink
from dart_lab.sim.serve import PacedWorld
from dart_lab.sim.truth import truth
from tests.common import MOCK_1_URL

SLOW = 2 * SAMPLE


class Wall:
    """A wall clock that advances on request."""

    def __init__(self) -> None:
        self.t = 0.0

    def __call__(self) -> float:
        return self.t


def rounds(timer: LoopTimer, wall: Wall, work: float, armed: bool = True, n: int = 1) -> None:
    for _ in range(n):
        timer.record_delivery()
        wall.t += work
        timer.record_request(1, armed=armed)


def test_late_rounds_are_counted_and_reported_once_at_the_end(caplog):
    wall = Wall()
    timer = LoopTimer(wall)
    timer.record_request(1, armed=True)
    rounds(timer, wall, 0.9 * SLOW)
    rounds(timer, wall, 2 * SLOW)
    rounds(timer, wall, 3 * SLOW)
    assert (caplog.messages, timer.late) == ([], 2)
    assert timer.work() == pytest.approx((2 * SLOW, 3 * SLOW))
    timer.report_overruns(waits=False)
    (message,) = caplog.messages
    assert "late in 2 of 3 rounds: it took up to 60 ms" in message


@pytest.mark.parametrize(("late", "messages"), [(5, 0), (6, 1)])
def test_up_to_one_late_round_in_twenty_is_not_reported(late, messages, caplog):
    wall = Wall()
    timer = LoopTimer(wall)
    rounds(timer, wall, SLOW / 4, n=100 - late)
    rounds(timer, wall, 2 * SLOW, n=late)
    timer.report_overruns(waits=True)
    assert (len(caplog.messages), timer.late) == (messages, late)


def test_a_loop_at_a_lower_rate_has_its_own_period_to_work(caplog):
    wall = Wall()
    timer = LoopTimer(wall)
    for work, late in ((0.10, 0), (0.12, 1)):
        timer.record_delivery()
        wall.t += work
        timer.record_request(10, armed=True)
        assert timer.late == late
    timer.report_overruns(waits=True)
    assert "they come each 100 ms" in caplog.text


@pytest.mark.parametrize(("verb", "waits", "messages"), [
    ("drive", True, True), ("experiment", True, False), ("experiment", False, True)])
def test_a_verb_warns_of_its_own_loop_only_what_a_real_car_would_notice(verb, waits, messages,
                                                                       capsys):
    wall = Wall()
    timer = LoopTimer(wall)
    with contextlib.suppress(SystemExit):
        main([verb, "--help"])
    capsys.readouterr()
    rounds(timer, wall, 0.1)
    timer.report_overruns(waits=waits)
    assert ("it took up to 100 ms" in capsys.readouterr().err) == messages


def test_no_round_is_late_while_the_car_is_disarmed(caplog):
    wall = Wall()
    timer = LoopTimer(wall)
    rounds(timer, wall, 1.0, armed=False)
    timer.report_overruns(waits=True)
    assert (caplog.messages, timer.late) == ([], 0)


def test_before_two_states_no_work_is_known():
    assert all(math.isnan(value) for value in LoopTimer(Wall()).work())


@pytest.mark.slow
def test_a_slow_loop_is_reported_once_though_virtual_time_waits_for_it(caplog):
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        caplog.clear()
        with caplog.at_level(logging.WARNING, "dart_hal"):
            for _ in car.states(duration=0.05):
                car.drive(throttle=0.1)
                time.sleep(1.1 * SLOW)
            assert not caplog.messages
            timing = car.timing
            car.close()
    (text,) = [text for text in caplog.messages if "the loop was late" in text]
    assert "pace=1" in text
    assert timing.late >= 2
    assert timing.p99 == pytest.approx(0.01, rel=0.01)
    assert timing.work_max >= 1.1 * SLOW


def drive_slowly(car: Car, work: float) -> None:
    for _ in car.states(duration=5.0):
        car.drive(throttle=0.2)
        time.sleep(work)


class Counting(Link):
    """A world that moves by ``sleep`` alone."""

    def __init__(self) -> None:
        self.t = 0.0

    def read(self, timeout: float) -> Chunk | None:
        return None

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...

    def pass_time(self, seconds: float) -> None:
        self.t += seconds


def test_a_paced_world_is_where_the_wall_clock_is(monkeypatch):
    wall = Wall()
    world = Counting()
    monkeypatch.setattr("dart_hal.devices.links.paced.time.monotonic", wall)
    paced = PacedLink(world, lambda: world.t, world.pass_time, "take fewer")
    wall.t = 0.1
    assert paced.now() == pytest.approx(0.1)
    paced.write(b"x")
    assert world.t == pytest.approx(0.1)


def test_a_world_that_cannot_keep_up_is_not_chased_and_reports_it_once(monkeypatch, caplog):
    wall = Wall()
    world = Counting()
    monkeypatch.setattr("dart_hal.devices.links.paced.time.monotonic", wall)
    paced = PacedLink(world, lambda: world.t, world.pass_time, "take fewer")
    for wall.t in (10.0, 20.0):
        paced.now()
    assert world.t == 0.0
    wall.t += 0.1
    assert paced.now() == pytest.approx(0.1)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].endswith("take fewer")


def test_a_world_that_cannot_keep_up_is_given_a_remedy_that_its_url_does_not_have(
        monkeypatch, caplog):
    backend = open_backend(MOCK_1_URL + "&pace=1")
    monkeypatch.setattr("dart_hal.devices.links.paced.time.monotonic", lambda: 1e9)
    backend.clock.now()
    assert "without pace=1" in caplog.text
    assert "nano=mock" not in caplog.text


@pytest.mark.slow
def test_a_paced_car_drives_on_while_its_program_computes():
    with Car.open(MOCK_1_URL + "&pace=1") as car:
        car.arm()
        with pytest.raises(Disarmed):
            drive_slowly(car, 0.3)
        assert car.causes == ("COMMAND_EXPIRED",)
        assert car.timing.skipped > 10


@pytest.mark.slow
@pytest.mark.realtime
def test_a_paced_car_obeys_a_loop_that_is_quick():
    backend = open_backend(MOCK_1_URL + "&pace=1")
    with Car.over(backend) as car:
        car.arm()
        for _ in car.states(duration=1.0):
            car.drive(throttle=0.3, valid_for=0.5)
        assert truth(backend).v_x > 0.2


def test_a_paced_car_is_not_served_once_more():
    backend = open_backend(MOCK_1_URL + "&pace=1")
    with pytest.raises(UsageError, match="cannot be served"):
        PacedWorld(backend)
    backend.close()


def test_a_pace_that_is_none_is_refused():
    with pytest.raises(UsageError, match="pace"):
        open_backend(MOCK_1_URL + "&pace=2")
