"""Driving off by the stick of the page in a real browser."""

from __future__ import annotations

import time

from at_the_desk import driving


def drives_off(browser, page, car, tries=5):
    """Arm and hold the stick until the car drives: on a busy computer a hold may end by itself."""
    browser.press("take")
    browser.until("Let go of the wheel", "take")
    for _ in range(tries):
        browser.until("DISARMED", "mode")
        browser.press("arm")
        try:
            browser.until("ARMED", "mode", within=5.0)
        except AssertionError:  # refused: frames came late
            continue
        browser.hold()
        time.sleep(0.5)  # a stick that reports nothing for 0.95 s is neutral
        if driving(page.pulses, car.now - 0.05):
            return
        browser.let_go()
    raise AssertionError(browser.text("said"))
