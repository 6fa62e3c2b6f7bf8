"""STOP in a real browser: with every focus, in every layout, and when no place is free."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack

import pytest

from dart_hal.car import Fleet
from dart_hal.core.errors import NotArmed
from dart_hal.fleet.station import Station
from dart_lab.live.view import server
from dart_lab.live.view.fleet_desk import FleetPage
from tests.live.view.browser import Browser, selenium
from tests.live.view.sockets import join, live_page

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
SAME_PRESS = 0.45
"""s after which a press is another one."""
SIZES = [(1280, 800), (390, 844), (844, 390), (667, 375), (932, 430), (1024, 600)]

FOREIGN = """
const place = document.createElement('div');
place.innerHTML = `<input type=text><input type=search><input type=number><input type=range>
<input type=checkbox><input type=radio><input type=date><input type=file><textarea></textarea>
<a href="#x">link</a><details><summary>more</summary></details><div contenteditable>text</div>
<select><option>a</option><option>b</option></select><select size=3><option>a</option></select>
<button>press</button><canvas tabindex=0 width=9 height=9></canvas><video controls></video>`;
document.querySelector('main').append(place);
for (const one of document.querySelectorAll('[hidden]')) one.hidden = false;
for (const one of document.querySelectorAll('[disabled]')) one.disabled = false;
window.clicks = 0;
addEventListener('click', () => clicks++, true);
"""
"""Elements of every kind that can have the focus, besides those of the page."""
FOCUSABLE = """
window.found = [...document.querySelectorAll('*')].filter((one) => {
  if (one.focus) one.focus();
  return document.activeElement === one;
});
document.activeElement.blur();
return found.map((one) => one.tagName + (one.id ? '#' + one.id : '') + (one.type ? ':' + one.type : ''));
"""  # noqa: E501 - one line of the page
COVERED = """
const of = document.getElementById(arguments[0]).getBoundingClientRect();
let missed = 0;
for (let a = 0; a < 2 * Math.PI; a += 0.2) for (const r of [0, 0.5, 0.95]) {
  const x = (of.left + of.right) / 2 + r * of.width / 2 * Math.cos(a);
  const y = (of.top + of.bottom) / 2 + r * of.height / 2 * Math.sin(a);
  const hit = document.elementFromPoint(x, y);
  if (!hit || !hit.closest('#' + arguments[0])) missed++;
}
return missed;
"""
"""Points of a round element that a finger does not reach."""
BOX = """
const r = document.getElementById(arguments[0]).getBoundingClientRect();
return [r.left, r.top, r.right, r.bottom];
"""


def press_space(browser):
    selenium.ActionChains(browser.driver).send_keys(" ").perform()


def resize(browser, size):
    browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 1000})


def not_stopped(browser, count):
    """Elements with which Space does not stop; ``count()``: STOPs so far."""
    browser.run(FOREIGN)
    names = browser.run(FOCUSABLE)
    silent = []
    for n, name in enumerate(names):
        browser.run(f"found[{n}].focus()")
        before = count()
        press_space(browser)
        time.sleep(SAME_PRESS)
        if count() != before + 1:
            silent.append(name)
    assert browser.run("return clicks") == 0, "Space presses nothing else"
    return names, silent


def count_calls(monkeypatch, owner, method):
    """Count the calls of a method; return the counter."""
    calls = []
    real = getattr(owner, method)

    def call(*args):
        calls.append(args)
        return real(*args)

    monkeypatch.setattr(owner, method, call)
    return lambda: len(calls)


@pytest.fixture
def car_page(browsers, monkeypatch):
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        yield car, page, one, count_calls(monkeypatch, page.desk, "_stop")


def test_space_stops_with_every_focus(car_page):
    _, _, one, count = car_page
    names, silent = not_stopped(one, count)
    assert len(names) >= 25
    assert {"SELECT#channel0:select-one", "BUTTON#take:submit", "INPUT#follow:checkbox",
            "DIV#stick", "BUTTON#stop:submit", "INPUT:text", "TEXTAREA:textarea", "A",
            "SUMMARY"} <= set(names)
    assert silent == []


def test_control_a_page_that_leaves_space_to_menus_is_detected(browsers, monkeypatch):
    real = server.load_assets

    def change_page(page):
        found = real(page)
        kind, body = found["/stop.js"]
        rule = b"if (isSpace(event)) { event.preventDefault(); event.stopPropagation(); stop(); }"
        assert rule in body
        found["/stop.js"] = kind, body.replace(
            rule, rule.replace(b"isSpace(event)", b"isSpace(event) && !event.target.options"))
        return found

    monkeypatch.setattr(server, "load_assets", change_page)
    with live_page() as (_, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        _, silent = not_stopped(one, count_calls(monkeypatch, page.desk, "_stop"))
        assert {name.partition("#")[0].partition(":")[0] for name in silent} == {"SELECT"}


def test_space_stops_while_a_menu_is_open_and_keys_drive_after_it(car_page):
    _, _, one, count = car_page
    one.press("channel0")
    assert not one.run("return document.querySelector('.list').hidden")
    press_space(one)
    time.sleep(SAME_PRESS)
    assert count() == 1
    item = one.driver.find_elements("css selector", ".list button")[2]
    label = item.text
    item.click()
    assert one.run("return document.getElementById('channel0').value") == label
    press_space(one)
    time.sleep(SAME_PRESS)
    assert count() == 2
    selenium.ActionChains(one.driver).key_down("w").perform()
    assert one.run("return Stick.read()") == [0, 1], "WASD after a plot was chosen"
    selenium.ActionChains(one.driver).key_up("w").perform()
    one.run("document.getElementById('channel0').focus()")
    selenium.ActionChains(one.driver).key_down("w").perform()
    assert one.run("return Stick.read()") == [0, 1], "and while its menu has the focus"
    selenium.ActionChains(one.driver).key_up("w").perform()
    assert one.run("return document.getElementById('channel0').value") == label


def test_space_stops_all_cars_with_every_focus_of_the_page_of_a_fleet(browsers, monkeypatch):
    urls = ["sim://?nano=mock&pace=1&seed=1"]
    ended = threading.Event()
    with Fleet.open(urls, room="local://focus") as fleet, Station("local://focus") as station, \
            FleetPage([station], 0, lan=False) as page:
        count = count_calls(monkeypatch, Station, "call_stop")
        loop = threading.Thread(target=lambda: next(
            (None for _ in fleet.states() if ended.is_set()), None))
        loop.start()
        try:
            one = browsers()
            one.open(page.urls[0])
            time.sleep(1.0)
            names, silent = not_stopped(one, count)
            assert len(names) >= 20
            assert silent == []
        finally:
            ended.set()
            loop.join()


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_every_layout_shows_stick_stop_and_the_reason_of_a_trip(browsers, size):
    with live_page() as (car, page):
        one = browsers()
        resize(one, size)
        one.driver.get(page.urls[0])
        one.until("DISARMED", "mode")
        one.press("take")
        one.until("Let go of the wheel", "take")
        check_layout(one, size)
        stop_armed(one, car)
        check_layout(one, size)
        _, top, right, bottom = one.driver.execute_script(BOX, "trouble")
        header = one.driver.find_element("tag name", "header").rect
        assert top == pytest.approx(header["y"] + header["height"], abs=1), "under the header"
        assert bottom - top > 20
        stop = one.driver.execute_script(BOX, "stop")
        assert bottom <= stop[1] or right <= stop[0], "and not behind STOP"
        assert not {"member.held", "car.arm"} & set(one.text("trouble").split())


def stop_armed(browser, car, tries=4):
    """STOP an armed car; one that a busy computer has tripped before is armed again."""
    for _ in range(tries):
        if car.mode == "LOCKED":
            car.unlock("test")
        browser.until("DISARMED", "mode")
        arm_from_page(browser)
        browser.press("stop")
        try:
            browser.until("STOP was pressed at a live page.", "trouble", within=2.0)
            return
        except AssertionError:
            continue
    raise AssertionError(browser.text("trouble"))


def arm_from_page(browser, tries=5):
    """A busy computer is refused at times, as frames come late."""
    for _ in range(tries):
        browser.press("arm")
        try:
            browser.until("ARMED", "mode", within=5.0)
            return
        except AssertionError:
            continue
    raise AssertionError(browser.text("said"))


def check_layout(browser, size):
    """Stick and STOP are in sight without scrolling, and neither lies on the other."""
    assert browser.run("return document.documentElement.scrollWidth") <= size[0]
    for name in ("stick", "stop", "take", "arm"):
        left, top, right, bottom = browser.driver.execute_script(BOX, name)
        assert 0 <= left < right <= size[0], name
        assert 0 <= top < bottom <= size[1], name
    assert browser.driver.execute_script(COVERED, "stick") == 0
    middle = browser.run("const r = document.getElementById('stop').getBoundingClientRect();"
                         "return document.elementFromPoint((r.left + r.right) / 2,"
                         " (r.top + r.bottom) / 2).id")
    assert middle == "stop"
    stop = browser.driver.execute_script(BOX, "stop")
    assert (stop[2] - stop[0]) * (stop[3] - stop[1]) > 60 * 100, "a thumb finds it"


def test_stop_works_where_no_place_is_free(browsers, monkeypatch):
    """The page was replaced by a newer one; or none is free for it."""
    monkeypatch.setattr(server, "MAX_PAGES", 1)
    with live_page() as (car, page), ExitStack() as stack:
        one = browsers()
        one.open(page.urls[0].partition("#")[0])
        one.until("DISARMED", "mode")
        stack.enter_context(join(page))
        one.until("full", "mode")
        one.until("its STOP works", "said")
        stop_of(one, car)
        monkeypatch.setattr(server, "MIN_REPLACE_PERIOD_S", 1e9)
        one.driver.refresh()
        one.until("full", "mode")
        one.until("its STOP works", "said")
        stop_of(one, car)


def stop_of(browser, car):
    """Arm the car, press Space, and see it tripped."""
    for _ in range(5):
        try:
            car.arm()
            break
        except NotArmed:
            continue
    press_space(browser)
    ends = time.monotonic() + 2.0
    while car.mode != "TRIPPED" and time.monotonic() < ends:
        time.sleep(0.01)
    assert car.mode == "TRIPPED"


def test_a_stop_that_reaches_no_car_is_reported(browsers):
    with live_page() as (_, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        page.close()
        one.until("gone", "mode")
        Browser.press(one, "stop")
        one.until("STOP did not reach the program", "said")
