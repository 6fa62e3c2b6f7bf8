"""A camera through OpenCV: images with times, and one that is unplugged, hangs, or is not there."""

from __future__ import annotations

import os
import sys
import time

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import NoImage, PortBusy, PortDenied, PortMissing, UsageError
from dart_hal.devices.camera import capture, open_camera
from tests.devices.camera.fake_opencv import JPEG, FakeOpenCV

pytestmark = pytest.mark.realtime


@pytest.fixture
def cv2(monkeypatch, tmp_path):
    """The fake in place of OpenCV, and its device."""
    device = tmp_path / "video0"
    device.touch()
    fake = FakeOpenCV(device)
    monkeypatch.setitem(sys.modules, "cv2", fake)
    monkeypatch.setattr(capture, "CAMERA_RETRY_INTERVAL", 0.05)
    yield fake
    fake.hangs.clear()


def until(condition, within=3.0):
    ends = time.monotonic() + within
    while not condition():
        assert time.monotonic() < ends
        time.sleep(0.01)


def test_images_come_with_their_times_on_the_cars_clock(cv2):
    camera = open_camera(f"usb:{cv2.path}?width=800&fps=30&quality=60")
    try:
        assert cv2.settings == {3: 800, 4: 480, 5: 30, 38: 1}
        assert cv2.opened == [(str(cv2.path), 200)]
        time.sleep(0.1)
        images = camera.poll(1000.0)
        assert images
        assert all(999.0 < image.t <= image.arrival <= 1000.0 for image in images)
        assert [image.t for image in images] == sorted(image.t for image in images)
        assert images[-1].size == (640, 480)
        assert images[-1].jpeg.startswith(JPEG)
        assert camera.trouble is None
    finally:
        camera.close()
    until(lambda: cv2.held == 0)


def test_images_that_are_not_polled_are_dropped_except_the_newest(cv2):
    cv2.fps = 200.0
    camera = open_camera(f"usb:{cv2.path}")
    try:
        until(lambda: cv2.count > 3 * capture.MAX_WAITING_IMAGES)
        images = camera.poll(0.5)
        assert len(images) <= capture.MAX_WAITING_IMAGES
        assert 0.5 - images[-1].t < 0.1
    finally:
        camera.close()


def test_an_unplugged_camera_is_reported_and_continues_when_plugged_in(cv2):
    camera = open_camera(f"usb:{cv2.path}")
    try:
        cv2.there = False
        until(lambda: camera.trouble is not None)
        assert isinstance(camera.trouble, NoImage)
        assert "is gone" in str(camera.trouble)
        assert "plug it in" in camera.trouble.remedy
        cv2.path.unlink()  # as udev does
        time.sleep(0.2)
        assert cv2.held == 0, "its device is let go, or it would come back under another number"
        cv2.path.touch()
        cv2.there = True
        until(lambda: camera.trouble is None)
        camera.poll(1.0)
        until(lambda: camera.poll(1.0))
    finally:
        camera.close()


@pytest.mark.slow
def test_one_that_hangs_holds_up_neither_the_car_nor_its_end(cv2, monkeypatch):
    monkeypatch.setattr(capture, "MAX_IMAGE_GAP", 0.3)
    with Car.open("sim://?nano=mock&pace=1", camera=f"usb:{cv2.path}") as car:
        car.arm()
        states = car.states(duration=2.0)
        until(lambda: next(states).image is not None)
        cv2.hangs.set()
        begun, count = time.monotonic(), 0
        for _ in states:
            car.drive(throttle=0.2)
            count += 1
        assert count / (time.monotonic() - begun) > 80.0, "States come at 100 Hz"
        assert car.mode == "ARMED"
        assert "silent" in str(car.camera.trouble)
        begun = time.monotonic()
    assert time.monotonic() - begun < 1.5


def test_a_car_in_real_time_records_them(cv2, tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open("sim://?nano=mock&pace=1", camera=f"usb:{cv2.path}", record=path) as car:
        for state in car.states(duration=0.5):
            pass
        live = [state.image, *car.camera.images()]
        assert car.camera.health.rate > 20.0
    with Car.open(f"replay://{path}") as car:
        again = {s.t: (s.image, car.camera.images()) for s in car.states()}
    assert again[state.t][0] == live[0]
    assert set(live) <= {image for _, came in again.values() for image in came}


def test_another_program_has_it(cv2):
    cv2.takes = False
    with pytest.raises(PortBusy, match="gives no picture") as busy:
        open_camera(f"usb:{cv2.path}")
    assert "fuser" in busy.value.remedy
    cv2.takes, cv2.there = True, False  # it opens, and streams for somebody else
    with pytest.raises(PortBusy):
        open_camera(f"usb:{cv2.path}")
    assert cv2.held == 0


def test_one_that_may_not_be_opened(cv2, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PortDenied, match="may not be opened") as denied:
        open_camera(f"usb:{cv2.path}")
    assert "-aG video" in denied.value.remedy


def test_one_that_is_not_there(cv2):
    with pytest.raises(PortMissing, match="there is no camera") as missing:
        open_camera(f"usb:{cv2.path}9")
    assert "/dev/video" in missing.value.remedy
    assert cv2.opened == []


def test_the_ribbon_of_a_jetson_needs_its_own_opencv(cv2):
    with pytest.raises(UsageError, match="no GStreamer") as no:
        open_camera("csi:0")
    assert "with GStreamer" in no.value.remedy
    cv2.gstreamer = "YES (1.20.3)"
    camera = open_camera("csi:1?width=1280&height=720&fps=30")
    camera.close()
    pipeline, api = cv2.opened[-1]
    assert api == cv2.CAP_GSTREAMER
    assert "sensor-id=1" in pipeline
    assert "width=1280,height=720,framerate=30/1" in pipeline


def test_without_opencv_the_error_names_the_package_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(UsageError, match="needs OpenCV") as no:
        open_camera("usb:0")
    assert "opencv-python-headless>=" in no.value.remedy


@pytest.mark.parametrize(("text", "found"), [
    ("colour://red", "is no camera"), ("usb:", "is no camera"), ("usb:video0", "is no camera"),
    ("csi:/dev/video0", "is no camera"), ("usb://[", "is no camera"), ("top", "is no camera"),
    ("usb:0?width=wide", "width=wide"), ("usb:0?fps=0", "fps=0"), ("usb:0?fps=\u0661", "fps="),
    ("usb:0?colour=red", "options of a camera"), ("usb:0?fps=5&fps=6", "options of a camera")])
def test_what_is_no_camera_is_refused(text, found):
    with pytest.raises(UsageError, match=found):
        open_camera(text)
