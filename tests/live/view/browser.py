"""A window of a real browser, headless chromium, driven as a person would."""

from __future__ import annotations

import shutil
import time

import pytest

selenium = pytest.importorskip("selenium.webdriver")
from selenium.webdriver.chrome.service import Service  # noqa: E402 - after the skip

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync")
DESK = (1280, 800)
PHONE = (390, 844)


class Browser:
    """One window."""

    def __init__(self):
        options = selenium.ChromeOptions()
        for flag in FLAGS:
            options.add_argument(flag)
        options.binary_location = shutil.which("chromium")
        self.driver = selenium.Chrome(options=options,
                                      service=Service(shutil.which("chromedriver")))

    def renew(self):
        """Replace its windows by a new one, in which nothing of an earlier page is left."""
        selenium.ActionChains(self.driver).reset_actions()
        self.driver.execute_cdp_cmd("Network.clearBrowserCookies", {})
        old = self.driver.window_handles
        self.driver.switch_to.new_window("window")
        new = self.driver.current_window_handle
        for window in old:
            self.driver.switch_to.window(window)
            self.driver.close()
        self.driver.switch_to.window(new)
        self.driver.get_log("browser")  # what is read here is not read again

    def open(self, url, size=DESK):
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size == PHONE})
        self.driver.get(url)

    def __getitem__(self, name):
        return self.driver.find_element("id", name)

    def press(self, name):
        self[name].click()

    def text(self, name):
        return self[name].text

    def until(self, what, name, within=30.0):
        ends = time.monotonic() + within
        while time.monotonic() < ends:
            shown = self.text(name)
            if shown == what if name == "mode" else what in shown:
                return
            time.sleep(0.05)
        raise AssertionError(f"{name} shows {self.text(name)!r}, not {what!r}")

    def run(self, script):
        return self.driver.execute_script(script)

    def hold(self):
        hand = selenium.ActionChains(self.driver)
        hand.move_to_element(self["stick"]).click_and_hold().move_by_offset(-20, -80).perform()

    def let_go(self):
        selenium.ActionChains(self.driver).release().perform()
