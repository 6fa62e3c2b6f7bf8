"""Keys and gamepad at the page: what they ask for, and that they let go."""

from __future__ import annotations

import time

import pytest

from tests.live.view.at_the_desk import driving
from tests.live.view.browser_drive import drives_off
from tests.live.view.sockets import live_page

pytestmark = [pytest.mark.realtime, pytest.mark.slow]
KEY_EVENT = "dispatchEvent(new KeyboardEvent('{}', {{code: '{}', bubbles: true}}))"
PAD = """
const pad = {{buttons: Array.from({{length: 9}}, (_, n) => ({{pressed: n === {} }})), axes: [-0.5, 0, 0, {}]}};
Object.defineProperty(navigator, 'getGamepads', {{value: () => [null, pad], configurable: true}});
"""  # noqa: E501 - one line of the page
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


def test_a_gamepad_drives_while_its_bumper_is_held(page):
    page.run(PAD.format(5, -0.8))
    assert page.run(READ) == pytest.approx([0.5, 0.8])
    page.run(PAD.format(5, -0.04))
    assert page.run(READ) == pytest.approx([0.5, 0.0]), "a worn stick rests off its middle"
    page.run(PAD.format(4, -0.8))
    assert page.run(READ) is None, "control: another button"


def test_a_stick_a_key_and_a_gamepad_that_report_nothing_grow_old(page):
    page.run(PAD.format(5, -0.8))
    page.run("window.ages = []; window.reads = setInterval(() => { Stick.read();"
             "ages.push(Stick.unchanged()); }, 20)")
    time.sleep(1.2)
    assert page.run("return ages.at(-1)") > 1000, "it is read all the time, and never changes"
    page.run(PAD.format(5, -0.7))
    time.sleep(0.1)
    assert page.run("return ages.at(-1)") < 500
    page.run(PAD.format(4, 0.0))
    press(page, "KeyW")
    time.sleep(0.6)
    assert page.run("return ages.at(-1)") > 400
    press(page, "KeyW")
    assert page.run("Stick.read(); return Stick.unchanged()") < 200, "a repeat is a report"
    press(page, "KeyW", what="keyup")
    page.hold()
    time.sleep(0.6)
    assert page.run("return ages.at(-1)") > 400


def test_a_held_stick_without_a_report_is_neutral_with_a_reason(browsers):
    with live_page() as (car, page):
        one = browsers()
        one.open(page.urls[0])
        drives_off(one, page, car)
        time.sleep(1.5)
        assert driving(page.pulses, car.now - 0.2) == []
        one.until("did not change for 0.95 s", "said")
