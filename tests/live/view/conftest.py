"""Makes the helper modules of this folder importable under importmode=importlib; a browser."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def browsers():
    """Opens windows and closes them."""
    from browser import Browser  # selenium is loaded where it is used

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
