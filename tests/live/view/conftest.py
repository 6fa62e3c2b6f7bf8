"""A browser, where one is installed."""

from __future__ import annotations

import shutil

import pytest


@pytest.fixture
def browsers():
    """Opens windows and closes them."""
    from tests.live.view.browser import Browser  # selenium is loaded where it is used

    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("chromium is not installed: sh firmware/toolchain.sh --apt chromium "
                    "chromium-driver")
    opened = []

    def new():
        opened.append(Browser())
        return opened[-1]

    yield new
    for one in opened:
        one.driver.quit()
