"""Camera images on the page: the newest one, for pages that ask, in a replay too."""

from __future__ import annotations

import socket
import time
from base64 import b64decode
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import NoImage
from dart_lab.live.view import player
from dart_lab.live.view.messages import Stop
from dart_lab.live.view.player import Player, run_of
from tests.live.view.at_the_desk import driving
from tests.live.view.browser import DESK, PHONE
from tests.live.view.sockets import join, live_page, send_message, until

URL = "sim://?nano=mock&pace=1&camera=top&map=hall"
SHOWN = "return [picture.naturalWidth, picture.naturalHeight, picture.complete]"


def picture(page):
    with urlopen(f"http://localhost:{page.access.port}/camera.jpg") as answer:
        return answer.read(), answer.headers


@pytest.mark.realtime
def test_the_newest_image_is_served_and_no_page_of_another_origin_shows_it():
    with live_page(url=URL) as (car, page):
        with join(page) as one:
            assert until(one, "begin")["camera"] is True
            status = until(one, "status", where=lambda m: m["camera"]["rate"] is not None)
            assert status["camera"]["told"] == ""
            assert 0.0 < status["t"] - status["camera"]["t"] < 0.3
        jpeg, headers = picture(page)
        assert headers["Content-Type"] == "image/jpeg"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert jpeg in [image.jpeg for image in car.camera.images()[-2:]]


@pytest.mark.realtime
def test_without_a_camera_there_is_none():
    with live_page() as (_, page), join(page) as one:
        assert until(one, "begin")["camera"] is False
        assert until(one, "status")["camera"] is None
        with pytest.raises(HTTPError, match="404"):
            picture(page)


class LostCamera:
    """A camera that was unplugged before its first image."""

    name = "usb:0"
    trouble = NoImage("usb:0: the camera is gone")

    def poll(self, now):
        return []

    def close(self):
        pass


@pytest.mark.realtime
@pytest.mark.usefixtures("armed_esc")
def test_a_missing_camera_is_reported_and_the_car_is_stopped_and_driven_as_ever():
    with Car.open("sim://?nano=mock&pace=1", camera=LostCamera()) as car, \
            car.view(port=0) as page, \
            join(page) as one:
        car.arm()
        for _ in car.states(duration=0.3):
            car.drive(throttle=0.2)
        status = until(one, "status", where=lambda m: m["mode"] == "ARMED")
        assert "the camera is gone" in status["camera"]["told"]
        page.desk.handle_message(None, Stop())
        assert car.mode != "ARMED"


@pytest.mark.realtime
@pytest.mark.slow
def test_pages_that_request_images_and_read_none_delay_no_other():
    """Forty connections that ask and stall; samples, STOP and another's images go on."""
    with live_page(url=URL) as (_, page):
        stalled = []
        for _ in range(40):
            one = socket.create_connection(("localhost", page.access.port))
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            one.sendall(b"GET /camera.jpg HTTP/1.1\r\nHost: localhost:%d\r\n\r\n"
                        % page.access.port)
            stalled.append(one)
        with join(page) as one:
            rows = 0
            begun = time.monotonic()
            while time.monotonic() < begun + 2.0:
                message = until(one, "rows")
                rows += len(message["rows"])
            assert rows > 160, "100 a second"
            for _ in range(5):
                begun = time.monotonic()
                assert picture(page)[0][:2] == b"\xff\xd8"
                assert time.monotonic() - begun < 0.3
            send_message(one, type="stop")
            until(one, "said", where=lambda m: "STOP" in m["text"], within=1.0)
        for one in stalled:
            one.close()


def record_camera(path, seconds=1.0):
    with Car.open("sim://?nano=mock&camera=top", record=path) as car:
        car.arm()
        for _ in car.states(duration=seconds):
            car.drive(steering=0.3, throttle=0.25)
        return car.camera.images()


@pytest.mark.slow
def test_a_recorded_run_has_its_images_and_a_long_one_fewer(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    images = record_camera(path, 0.5)
    with Car.open(f"replay://{path}") as car:
        run = run_of(car)
    assert b64decode(run["images"][-1][1]) == images[-1].jpeg
    rows = [n for n, _ in run["images"]]
    assert rows == sorted(set(rows))
    assert run["rows"][rows[-1]][0] >= images[-1].t
    monkeypatch.setattr(player, "MAX_IMAGE_BYTES", 30_000)
    with Car.open(f"replay://{path}") as car:
        fewer = run_of(car)["images"]
    assert 2 <= len(fewer) < len(rows)
    assert sum(len(b64decode(jpeg)) for _, jpeg in fewer) <= 40_000


@pytest.mark.realtime
@pytest.mark.slow
@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_the_page_shows_what_the_camera_sees(browsers, size):
    with live_page(url=URL) as (_, page):
        one = browsers()
        one.open(page.urls[0], size)
        one.until("ms old", "taken")
        ends = time.monotonic() + 5.0
        while one.run(SHOWN) != [320, 240, True] and time.monotonic() < ends:
            time.sleep(0.1)
        assert one.run(SHOWN) == [320, 240, True]
        script = "return [Number(picture.src.split('?')[1]), performance.now()]"
        (first, began), ends = one.run(script), time.monotonic() + 10.0
        while (news := one.run(script))[0] < first + 5 and time.monotonic() < ends:
            time.sleep(0.1)
        assert 5 <= news[0] - first <= (news[1] - began) / 60.0 + 1.0, "once the last is drawn"
        assert one.run("return document.documentElement.scrollWidth") <= size[0]
        one.press("eye")
        assert one["eye"].size["width"] > 300
        assert [log for log in one.driver.get_log("browser") if log["level"] == "SEVERE"] == []
        assert not driving(page.pulses, 0.0)


@pytest.mark.realtime
@pytest.mark.slow
def test_a_recording_shows_the_image_of_its_time(browsers, tmp_path):
    path = tmp_path / "run.mcap"
    record_camera(path, 2.0)
    with Car.open(f"replay://{path}") as car:
        run = run_of(car)
    with Player(run, 0, lan=False) as played:
        one = browsers()
        one.open(played.urls[0])
        one.until("recorded", "mode")
        for part in (0.5, 1.0):
            one.run(f"const bar = document.getElementById('time'); bar.value = {part};"
                    "bar.dispatchEvent(new Event('input'))")
            row = round(part * (len(run["rows"]) - 1))
            jpeg = [jpeg for n, jpeg in run["images"] if n <= row][-1]
            ends = time.monotonic() + 5.0
            while not one.run("return picture.src").endswith(jpeg):
                assert time.monotonic() < ends
                time.sleep(0.05)
        assert one.run(SHOWN)[:2] == [320, 240]
