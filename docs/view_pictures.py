"""Pictures of the live page, by a headless browser: a page drives an emulated car on the track.

    python docs/view_pictures.py docs/pictures

Needs chromium with its driver (sh firmware/toolchain.sh --apt chromium chromium-driver) and the
packages of dart-hal[dev].
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from dart_hal import Car, Fleet
from dart_hal.fleet.station import Station
from dart_hal.view.fleet_desk import FleetPage

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--hide-scrollbars")
SIZES = {"view_desk": (1280, 800), "view_phone": (390, 844)}
TRIES = 5
"""Presses of Arm: on a busy computer frames come late, and arming is refused."""
URL = "sim://?nano=mock&pace=1&lidar=1&map=track&camera=top"


def browser() -> webdriver.Chrome:
    """A window without a screen."""
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(flag)
    options.binary_location = shutil.which("chromium") or ""
    return webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))


def shoot(url: str, folder: Path) -> None:
    """Drive off by the page, and take its picture in both sizes."""
    window = browser()
    try:
        resize(window, SIZES["view_desk"])
        window.get(url)
        reaches(window, "DISARMED", 30.0)
        window.find_element("id", "take").click()
        for _ in range(TRIES):
            reaches(window, "DISARMED", 30.0)
            window.find_element("id", "arm").click()
            if reaches(window, "ARMED", 8.0):
                break
        hand = webdriver.ActionChains(window)
        hand.move_to_element(window.find_element("id", "stick")).click_and_hold()
        hand.move_by_offset(-30, -50).perform()
        time.sleep(2.5)
        for name, size in SIZES.items():
            resize(window, size)
            time.sleep(0.6)
            window.save_screenshot(str(folder / f"{name}.png"))
    finally:
        window.quit()


def reaches(window: webdriver.Chrome, mode: str, within: float) -> bool:
    """Whether the page shows that mode within so many s."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        if window.find_element("id", "mode").text == mode:
            return True
        time.sleep(0.1)
    return False


def shoot_fleet(folder: Path) -> None:
    """Four emulated cars of a room, one of which is gone."""
    places = ("0,0,0", "1.5,0.6,1", "-1,1.2,2", "0.5,-1.2,3")
    urls = [f"sim://?nano=mock&pace=1&mocap=1&world=page&seed={n + 1}&at={place}"
            for n, place in enumerate(places)]
    with Fleet.open(urls, room="local://page") as fleet, Station("local://page") as station, \
            FleetPage([station], 0, lan=False) as page:
        fleet.arm()
        ends = time.monotonic() + 3.0
        for n, car in enumerate(fleet.cars[:2]):
            threading.Thread(target=circle, args=(car, 0.3 - 0.5 * n, ends + 9.0)).start()
        fleet.members[3].close()
        window = browser()
        try:
            resize(window, SIZES["view_desk"])
            window.get(page.urls[0])
            time.sleep(3.0)
            window.save_screenshot(str(folder / "view_fleet.png"))
        finally:
            window.quit()
            time.sleep(max(ends + 9.5 - time.monotonic(), 0.0))


def circle(car: Car, steering: float, until: float) -> None:
    """Drive at a steady steering angle [rad] until then."""
    for _ in car.states():
        if time.monotonic() > until:
            return
        car.drive(steering=steering, throttle=0.2)


def resize(window: webdriver.Chrome, size: tuple[int, int]) -> None:
    """The page's own width and height [px]."""
    window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 500})


def main(folder: str) -> None:
    """All pictures."""
    with Car.open(URL, raise_on_trip=False) as car, car.view(port=0, drives=True) as page:
        ended = threading.Event()
        loop = threading.Thread(target=lambda: page.run(ended=ended.is_set))
        loop.start()
        try:
            shoot(page.urls[0], Path(folder))
        finally:
            ended.set()
            loop.join()
    shoot_fleet(Path(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])
