"""A recorded run as a tool: speed, steps, numbers, two runs on one time bar, a link to a moment."""

from __future__ import annotations

import time

import pytest

from dart_lab.live.view.player import Player
from tests.live.view.test_browser_shows import within
from tests.live.view.test_floor import ORANGE, pixels
from tests.live.view.test_page_readable import make_run

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
NEXT_KEY = "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: '%s', bubbles: true}))"


def seconds_of(browser):
    return float(browser.text("at").partition(" ")[0])


def numbers(browser):
    return browser.text("numbers").replace("\n", " ")


@pytest.fixture
def open_at(browsers):
    """Open the page of a run, or of two, at a link."""
    players = []
    one = browsers()

    def open_run(link, run, second=None):
        players.append(Player(run, 0, lan=False, second=second))
        one.open(f"{players[-1].urls[0]}{link}")
        one.until("recorded", "mode")
        return one

    yield open_run
    for player in players:
        player.close()


def test_a_link_shows_its_moment_with_numbers_and_steps(open_at):
    one = open_at("#t=1.5", make_run(speed=lambda n: n / 100))
    assert one.text("at") == "1.5 s of 3.0 s"
    assert one.text("play") == "Play", "a moment that is linked is held"
    assert "1.50 m/s" in numbers(one)
    one.press("next")
    assert "1.51 m/s" in numbers(one)
    assert one.run("return location.hash") == "#t=1.51"
    one.press("back")
    one.press("back")
    assert "1.49 m/s" in numbers(one)
    one.run(NEXT_KEY % ".")
    assert "1.50 m/s" in numbers(one)
    one.run(NEXT_KEY % ",")
    assert "1.49 m/s" in numbers(one)
    one.run("location.hash = '#t=2.25'")
    within(2.0, lambda: "2.25 m/s" in numbers(one))
    one.run("location.hash = '#t=99'")
    within(2.0, lambda: one.text("at") == "3.0 s of 3.0 s")


def test_a_run_without_a_link_plays_by_itself(open_at):
    one = open_at("", make_run(2000))
    within(30.0, lambda: seconds_of(one) > 0.3)
    assert one.text("play") == "Pause"
    one.press("play")
    held = seconds_of(one)
    time.sleep(0.3)
    assert seconds_of(one) == held
    assert one.run("return location.hash").startswith("#t=")


@pytest.mark.parametrize("rate", [0.5, 1, 4])
def test_it_plays_at_the_chosen_speed(open_at, rate):
    one = open_at("#t=1", make_run(6000))
    one.run(f"const menu = document.getElementById('rate'); menu.value = '{rate}';"
            "menu.dispatchEvent(new Event('change'))")
    one.press("play")
    clock = ("return [performance.now() / 1000,"
             " parseFloat(document.getElementById('at').textContent)]")
    begun, was = one.run(clock)
    time.sleep(3.0)
    now, shown = one.run(clock)
    assert (shown - was) / (now - begun) == pytest.approx(rate, rel=0.2)


def test_two_runs_are_on_one_time_bar(open_at):
    later = make_run(speed=lambda n: 0.5, car="other")
    for row in later["rows"]:
        row[0] += 100.0  # its clock is another one
        row[2] = 0.5
    one = open_at("#t=2", make_run(speed=lambda n: n / 100), later)
    assert "2.00 m/s | 0.50 m/s" in numbers(one)
    assert "2.00 m 0.00 m | 2.00 m 0.50 m" in numbers(one)
    within(30.0, lambda: pixels(one, ORANGE) > 50)
    legend = "return document.querySelector('#plot0 .u-legend')?.innerText ?? ''"
    within(30.0, lambda: "second, speed" in one.run(legend))
    one = open_at("#t=2", make_run())
    assert "|" not in numbers(one), "control: one run"
    assert pixels(one, ORANGE) == 0
    within(30.0, lambda: "speed" in one.run(legend))
    assert "second" not in one.run(legend)


def test_a_shorter_second_run_ends_at_its_last_sample(open_at):
    one = open_at("#t=2", make_run(speed=lambda n: 1.0), make_run(101, speed=lambda n: n / 100))
    assert "1.00 m/s | 1.00 m/s" in numbers(one)
