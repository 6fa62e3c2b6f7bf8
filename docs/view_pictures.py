"""Pictures of the live page, by a headless browser: an emulated car drives in its room.

    python docs/view_pictures.py docs/pictures

Needs chromium with its driver (sh firmware/toolchain.sh --apt chromium chromium-driver) and the
packages of dart-hal[dev].
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from dart_hal import Car, Fleet
from dart_hal.core.errors import LinkLost, NotArmed
from dart_hal.core.timing import SAMPLE
from dart_hal.fleet.station import Station
from dart_lab.live.view.fleet_desk import FleetPage
from dart_lab.live.view.serve import LivePage
from dart_lab.sim.room_truth import lines_by_frame

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
         "--disable-background-networking", "--disable-component-update", "--disable-sync",
         "--hide-scrollbars")
SIZES = {"view_desk": (1280, 800), "view_phone": (390, 844)}
TRIES = 20
"""On a busy computer frames come late: a drive ends by itself."""
URL = "sim://?nano=mock&lidar=1&map=room&camera=top&battery=1&seed=2"
"""It waits for its program: on a busy computer it drives more slowly, and not with gaps."""


def browser() -> webdriver.Chrome:
    """A window without a screen."""
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(flag)
    options.binary_location = shutil.which("chromium") or ""
    return webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))


def shoot(car: Car, page: LivePage, folder: Path) -> None:
    """The page's picture in both sizes while the car drives a circle."""
    window, ended = browser(), threading.Event()
    driver = threading.Thread(target=circles, args=(car, 0.3, ended.is_set))
    try:
        resize(window, SIZES["view_desk"])
        window.get(page.urls[0])
        driver.start()
        for name, size in SIZES.items():
            resize(window, size)
            for _ in range(TRIES):
                while not drives(car, window):
                    time.sleep(0.2)
                window.save_screenshot(str(folder / f"{name}.png"))
                if drives(car, window):
                    break
            else:
                raise SystemExit("this computer is too busy: the car did not drive on")
    finally:
        ended.set()
        window.quit()
        driver.join()


def drives(car: Car, window: webdriver.Chrome) -> bool:
    """Whether it does, by itself and by its page."""
    speed = abs(car.recorder.logged.get("speed", 0.0))
    return speed > 0.2 and window.find_element("id", "mode").text == "ARMED"


def circles(car: Car, steering: float, ended: Callable[[], bool]) -> None:
    """Drive at a steady steering angle [rad], armed again where a busy computer ends it."""
    while not ended():
        with suppress(NotArmed, LinkLost):
            car.arm()
            start = time.monotonic()
            for tick, state in enumerate(car.states(duration=60.0)):
                time.sleep(max(start + tick * SAMPLE - time.monotonic(), 0.0))
                car.drive(steering=steering, throttle=0.25)
                car.log("speed", state.speed)
                if car.mode != "ARMED" or ended():
                    break


def shoot_fleet(folder: Path) -> None:
    """Four emulated cars of a room, one of which is gone.

    They wait for their program: four that do not need a processor each.
    """
    places = ("0,0,0", "1.5,0.6,1", "-1,1.2,2", "0.5,-1.2,3")
    urls = [f"sim://?nano=mock&mocap=1&world=page&seed={n + 1}&at={place}"
            for n, place in enumerate(places)]
    ended = threading.Event()
    with Fleet.open(urls, room="local://page") as fleet, Station("local://page") as station, \
            FleetPage([station], 0, lan=False) as page:
        fleet.arm()
        driver = threading.Thread(target=circle_together, args=(fleet, ended.is_set))
        window = browser()
        try:
            resize(window, SIZES["view_desk"])
            window.get(page.urls[0])
            driver.start()
            time.sleep(1.0)
            fleet.members[3].close()
            time.sleep(3.0)
            window.save_screenshot(str(folder / "view_fleet.png"))
        finally:
            ended.set()
            window.quit()
            driver.join()


def circle_together(fleet: Fleet, ended: Callable[[], bool]) -> None:
    """Let the first two cars drive circles, not faster than in real time."""
    start = time.monotonic()
    for tick, _ in enumerate(fleet.states()):
        if ended():
            return
        for n, car in enumerate(fleet.cars[:2]):
            car.drive(steering=0.3 - 0.5 * n, throttle=0.2)
        time.sleep(max(start + tick * SAMPLE - time.monotonic(), 0.0))


def resize(window: webdriver.Chrome, size: tuple[int, int]) -> None:
    """The page's own width and height [px]."""
    window.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 500})


def main(folder: str) -> None:
    """All pictures."""
    with Car.open(URL, raise_on_trip=False) as car, car.view(
            port=0, drives=True, lines=lines_by_frame(URL)) as page:
        shoot(car, page, Path(folder))
    shoot_fleet(Path(folder))


if __name__ == "__main__":
    main(*sys.argv[1:])
