"""Driving off by the stick of the page in a real browser."""

from __future__ import annotations

import time

from tests.live.view.at_the_desk import driving


def drives_off(browser, page, car, tries=5, watcher=None):
    """Arm and hold the stick until the car drives: on a busy computer a hold may end by itself.

    With another window as ``watcher``, a try counts only if that window shows ARMED, too.
    """
    browser.press("take")
    browser.until("Let go of the wheel", "take")
    for _ in range(tries):
        if browser.text("mode") != "ARMED":
            browser.until("DISARMED", "mode")
            browser.press("arm")
        try:
            browser.until("ARMED", "mode", within=5.0)
        except AssertionError:  # refused: frames came late
            continue
        browser.hold()
        time.sleep(0.5)  # a stick that reports nothing for 0.95 s is neutral
        if driving(page.pulses, car.now - 0.05) and shows_armed(watcher):
            return
        browser.let_go()
    raise AssertionError(browser.text("said"))


def shows_armed(watcher):
    """True where there is no such window, or once it shows ARMED."""
    if watcher is None:
        return True
    try:
        watcher.until("ARMED", "mode", within=5.0)
    except AssertionError:  # the hold ended by itself
        return False
    return True
