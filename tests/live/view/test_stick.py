"""Keys and gamepad at the page: what they ask for, and that they let go."""

from __future__ import annotations

import json
import time

import pytest

from tests.live.view.at_the_desk import driving
from tests.live.view.browser_drive import drives_off
from tests.live.view.sockets import live_page

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
KEY_EVENT = "dispatchEvent(new KeyboardEvent('{}', {{code: '{}', bubbles: true}}))"
PAD = """
const held = {held}, pad = {{
  id: 'pad of the test', index: 1, mapping: '{mapping}', axes: [-0.5, 0, 0, 0],
  buttons: Array.from({{length: 17}}, (_, n) => ({{pressed: n in held, value: held[n] ?? 0}}))}};
window.pad = pad;
Object.defineProperty(navigator, 'getGamepads',
                      {{value: () => [null, window.pad], configurable: true}});
"""
# Buttons of the standard layout.
PAD_STOP, PAD_BRAKE, PAD_GAS, PAD_BUMPER = 1, 6, 7, 5
READ = "return Stick.read()"


@pytest.fixture
def page(browsers):
    with live_page() as (_, page):
        one = browsers()
        one.open(page.urls[0])
        one.until("DISARMED", "mode")
        yield one


def press(page, *codes, what="keydown"):
    for code in codes:
        page.run(f"document.body.{KEY_EVENT.format(what, code)}")


def test_keys_drive_while_they_are_down(page):
    assert page.run(READ) is None
    press(page, "KeyW")
    assert page.run(READ) == [0, 1]
    press(page, "ArrowLeft")
    assert page.run(READ) == [1, 1]
    press(page, "KeyW", "ArrowLeft", what="keyup")
    assert page.run(READ) is None
    press(page, "KeyS", "KeyD")
    assert page.run(READ) == [-1, -1]
    page.run("dispatchEvent(new Event('blur'))")
    assert page.run(READ) is None, "a page that is not looked at holds nothing"


def hold_pad(page, held, mapping="standard"):
    """Show the page a pad whose buttons have these values, all others released."""
    page.run(PAD.format(held=json.dumps(held), mapping=mapping))


def test_a_gamepad_drives_while_its_bumper_is_held(page):
    hold_pad(page, {PAD_BUMPER: 1})
    assert page.run(READ) == pytest.approx([0.5, 0.0])
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.8})
    assert page.run(READ) == pytest.approx([0.5, 0.8])
    hold_pad(page, {PAD_BUMPER: 1, PAD_BRAKE: 0.6})
    assert page.run(READ) == pytest.approx([0.5, -0.6])
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.04})
    assert page.run(READ) == pytest.approx([0.5, 0.0]), "a worn trigger rests off its end"
    hold_pad(page, {PAD_GAS: 0.8})
    assert page.run(READ) is None, "control: no bumper"


def test_a_trigger_counts_after_it_was_seen_at_rest(page):
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.5})
    assert page.run(READ) == pytest.approx([0.5, 0.0])
    hold_pad(page, {PAD_BUMPER: 1})
    page.run(READ)
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.5})
    assert page.run(READ) == pytest.approx([0.5, 0.5])


def test_a_pad_without_the_standard_layout_is_refused(page):
    hold_pad(page, {PAD_BUMPER: 1}, mapping="")
    page.run(READ)
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.8, PAD_STOP: 1}, mapping="")
    assert page.run(READ) is None
    assert page.run("return Stick.isStopPressed()") is False
    page.until('no standard layout for the gamepad "pad of the test"', "said")
    assert page.text("said").count("no standard layout") == 1
    hold_pad(page, {PAD_STOP: 1})
    assert page.run("return Stick.isStopPressed()") is True, "control: a standard pad"


def test_a_stick_a_key_and_a_gamepad_that_report_nothing_grow_old(page):
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.8})
    page.run("window.ages = []; window.reads = setInterval(() => { Stick.read();"
             "ages.push(Stick.unchanged()); }, 20)")
    time.sleep(1.2)
    assert page.run("return ages.at(-1)") > 1000, "it is read all the time, and never changes"
    hold_pad(page, {PAD_BUMPER: 1, PAD_GAS: 0.7})
    time.sleep(0.1)
    assert page.run("return ages.at(-1)") < 500
    hold_pad(page, {})
    press(page, "KeyW")
    time.sleep(0.6)
    assert page.run("return ages.at(-1)") > 400
    press(page, "KeyW")
    assert page.run("Stick.read(); return Stick.unchanged()") < 200, "a repeat is a report"
    press(page, "KeyW", what="keyup")
    page.hold()
    time.sleep(0.6)
    assert page.run("return ages.at(-1)") > 400


def test_a_gamepad_drives_the_car_and_stops_it(browsers):
    """At the ESC pin: arming, a released bumper, a pad that reports nothing, B."""
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        arm_with_pad(one, car)
        # 1. A stick that moves a little, as under a thumb, and a trigger at half.
        began = car.now
        hold_pad(one, {PAD_BUMPER: 1, PAD_GAS: 0.5})
        one.run("window.shake = setInterval(() => { pad.axes[0] += 0.001; }, 50)")
        time.sleep(1.5)
        assert driving(page.pulses, began)
        assert driving(page.pulses, car.now - 0.1), "longer than a pad without a report"
        # 2. The bumper is released: neutral, and armed.
        hold_pad(one, {PAD_GAS: 0.5})
        time.sleep(0.5)
        assert driving(page.pulses, car.now - 0.2) == []
        assert car.mode == "ARMED"
        # 3. A pad that reports nothing, as out of range.
        one.run("clearInterval(shake)")
        hold_pad(one, {PAD_BUMPER: 1, PAD_GAS: 0.6})
        time.sleep(1.6)
        assert driving(page.pulses, car.now - 0.2) == []
        one.until("did not change for 0.95 s", "said")
        # 4. B, without the bumper.
        hold_pad(one, {PAD_STOP: 1})
        one.until("TRIPPED", "mode", within=3.0)
        one.until("STOP was pressed", "said")


def test_a_pad_without_the_standard_layout_moves_nothing(browsers):
    """Negative control of the pulses above: the same buttons, an unknown layout."""
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        arm_with_pad(one, car)
        began = car.now
        hold_pad(one, {PAD_BUMPER: 1, PAD_GAS: 0.5, PAD_STOP: 1}, mapping="")
        time.sleep(1.0)
        assert driving(page.pulses, began) == []
        assert car.mode == "ARMED"


def arm_with_pad(browser, car):
    """Take the wheel with a released pad, and arm."""
    hold_pad(browser, {})
    browser.press("take")
    browser.until("Let go of the wheel", "take")
    for _ in range(5):  # refused on a busy computer: frames came late
        browser.until("DISARMED", "mode")
        browser.press("arm")
        ends = time.monotonic() + 10.0
        while car.mode != "ARMED" and time.monotonic() < ends:
            time.sleep(0.05)
        if car.mode == "ARMED":
            return
    raise AssertionError(browser.text("said"))


def test_a_held_stick_without_a_report_is_neutral_with_a_reason(browsers):
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        drives_off(one, page, car)
        time.sleep(1.5)
        assert driving(page.pulses, car.now - 0.2) == []
        one.until("did not change for 0.95 s", "said")
