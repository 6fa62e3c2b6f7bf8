"""A browser, where one is installed."""

from __future__ import annotations

import shutil

import pytest


@pytest.fixture(scope="session")
def idle_browsers():
    """Browsers of earlier tests: to start one takes longer than most of what is tested in it."""
    idle = []
    yield idle
    for one in idle:
        one.driver.quit()


@pytest.fixture
def browsers(idle_browsers):
    """Opens windows and closes them."""
    # selenium is loaded where it is used
    from selenium.common import WebDriverException

    from tests.live.view.browser import Browser

    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("chromium is not installed: sh firmware/toolchain.sh --apt chromium "
                    "chromium-driver")
    opened = []

    def new():
        opened.append(idle_browsers.pop() if idle_browsers else Browser())
        return opened[-1]

    yield new
    for one in opened:
        try:
            one.renew()
        except WebDriverException:
            one.driver.quit()  # what broke is not used again
        else:
            idle_browsers.append(one)
