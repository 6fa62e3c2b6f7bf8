"""The page in a real browser: headless chromium, driven as a person would."""

from __future__ import annotations

import time

import pytest

from dart_hal.car import Car
from dart_lab.live.view.player import Player, run_of
from tests.live.view.at_the_desk import driving
from tests.live.view.browser import DESK, PHONE, Browser, selenium
from tests.live.view.browser_drive import drives_off
from tests.live.view.sockets import live_page

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
NEUTRAL_AFTER_S = 0.250
EMPTY_PAGE = "data:text/html,<title>empty</title>"


def hides_later(browser):
    browser.let_go()
    time.sleep(0.5)
    hides(browser)


def hides(browser):
    browser.run("Object.defineProperty(document, 'hidden', {get: () => true});"
                "document.dispatchEvent(new Event('visibilitychange'))")


ENDS_IN_BROWSER = {"let go": Browser.let_go, "hidden": hides, "hidden later": hides_later,
                   "away": lambda browser: browser.run("location.href = 'about:blank'")}


@pytest.mark.parametrize("how", ENDS_IN_BROWSER)
def test_it_drives_while_the_stick_is_held_and_not_longer(browsers, how):
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        drives_off(one, page, car)
        ended = car.now
        ENDS_IN_BROWSER[how](one)
        if how == "let go":
            time.sleep(0.3)
            assert car.mode == "ARMED", "until it has been released for 10 s"
        t_sent = car.now  # the browser has acted by now
        time.sleep(0.8)
        assert driving(page.pulses, ended - 0.1), "it drove until then"
        assert max(fall for _, fall in driving(page.pulses, 0.0)) - t_sent <= NEUTRAL_AFTER_S
        if how == "let go":
            assert drives_again(one, car, page)
        else:
            assert car.mode != "ARMED"


def drives_again(browser, car, page):
    """Hold the stick again, without arming."""
    began = car.now
    browser.hold()
    time.sleep(0.5)
    return driving(page.pulses, began)


def test_a_page_that_hangs_drives_no_longer(browsers):
    """Its socket stays open, and nothing comes."""
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        drives_off(one, page, car)
        hung = car.now
        one.run("setTimeout(() => { const t = Date.now(); while (Date.now() < t + 1500); }, 0)")
        time.sleep(1.0)
        assert max(fall for _, fall in driving(page.pulses, hung - 0.2)) - hung <= NEUTRAL_AFTER_S
        assert car.mode != "ARMED"


def test_any_page_stops_it_and_all_are_informed(browsers):
    with live_page() as (car, page):
        one = browsers()
        other = browsers()
        one.open(page.urls[0])
        other.open(page.urls[0].partition("#")[0], PHONE)
        drives_off(one, page, car, watcher=other)
        other.press("stop")
        one.until("TRIPPED", "mode", within=3.0)
        one.until("STOP was pressed", "said")
        other.until("RUN_STOP", "trouble", within=3.0)
        other.until("TRIPPED", "mode")
        one.press("take")
        one.until("Take the wheel", "take")
        time.sleep(0.5)
        other.press("take")
        other.until("wrong token", "said")


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_it_fits_and_requests_nothing_from_elsewhere(browsers, size):
    with live_page(url="sim://?nano=mock&pace=1&lidar=1&map=room") as (_, page):
        one = browsers()
        one.open(page.urls[0], size)
        one.until("DISARMED", "mode")
        time.sleep(1.0)
        assert one.run("return document.documentElement.scrollWidth") <= size[0]
        names = one.run("return performance.getEntriesByType('resource').map((e) => e.name)")
        assert names
        assert all(name.startswith(f"http://localhost:{page.access.port}/") for name in names)
        stop = one["stop"].rect
        assert stop["y"] + stop["height"] <= size[1]
        assert [log for log in one.driver.get_log("browser") if log["level"] == "SEVERE"] == []


def test_a_renewed_browser_has_nothing_of_an_earlier_page(browsers):
    one = browsers()
    one.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument",
                               {"source": "window.left = 1; console.error('left')"})
    one.open(EMPTY_PAGE)
    assert one.run("return window.left") == 1, "control"
    one.driver.switch_to.new_window("tab")
    one.renew()
    assert len(one.driver.window_handles) == 1
    one.open(EMPTY_PAGE)
    assert one.run("return window.left") is None
    assert one.driver.get_log("browser") == []


def test_a_recording_has_a_time_bar(browsers, tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open("sim://?nano=mock", record=path) as car:
        car.arm()
        for _ in car.states(duration=3.0):
            car.drive(steering=0.2, throttle=0.3)
    with Car.open(f"replay://{path}") as car:
        run = run_of(car)
    with Player(run, 0, lan=False) as player:
        one = browsers()
        one.open(player.urls[0])
        one.until("recorded", "mode")
        one.run("const bar = document.getElementById('time'); bar.value = 1;"
                "bar.dispatchEvent(new Event('input'))")
        length = run["rows"][-1][0] - run["rows"][0][0]
        one.until(f"{length:.1f} s of {length:.1f} s", "at")
        assert not one["stop"].is_displayed()
        one.run("document.getElementById('play').focus()")
        was = one.text("play")
        selenium.ActionChains(one.driver).send_keys(" ").perform()
        time.sleep(0.2)
        assert one.text("play") != was, "the space bar presses what has the focus"
        assert "STOP" not in one.text("said")
