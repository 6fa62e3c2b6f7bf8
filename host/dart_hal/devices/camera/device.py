"""Which camera a URL names, and whether it is there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from dart_hal.core.errors import PortBusy, PortDenied, PortMissing, UsageError
from dart_hal.core.process.extras import install_command

EXPECTED = "usb:0, usb:/dev/video0?width=640&height=480&fps=15, csi:0, or top in sim://"
RANGES = {"width": (16, 4096), "height": (16, 4096), "fps": (1, 120), "quality": (1, 100)}
KINDS = ("usb", "csi")
_CSI = ("nvarguscamerasrc sensor-id={number} ! video/x-raw(memory:NVMM),width={width},"
        "height={height},framerate={fps}/1 ! nvvidconv ! video/x-raw,format=BGRx ! videoconvert ! "
        "video/x-raw,format=BGR ! appsink drop=true max-buffers=1")
"""How a Jetson hands out a camera on its ribbon; the newest picture alone waits."""


@dataclass(frozen=True, slots=True)
class Device:
    """kind usb or csi; place: /dev/videoN, or the number of the ribbon; width, height [px], fps
    [1/s]: what is asked for, the camera takes what it has next to it; quality: of JPEG, 1..100."""

    name: str
    kind: str
    place: str
    width: int = 640
    height: int = 480
    fps: int = 15
    quality: int = 80

    def capture(self) -> Any:
        """An open ``cv2.VideoCapture``. Raises UsageError, PortMissing, PortDenied, PortBusy."""
        cv2 = opencv()
        if self.kind == "csi":
            return self._opened(cv2, self._ribbon(cv2), cv2.CAP_GSTREAMER)
        self._look()
        capture = self._opened(cv2, self.place, cv2.CAP_V4L2)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.height)
        capture.set(cv2.CAP_PROP_FPS, self.fps)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # what waits is old
        return capture

    def _opened(self, cv2: ModuleType, place: str, api: int) -> Any:
        capture = cv2.VideoCapture(place, api)
        if not capture.isOpened():
            capture.release()
            raise self.busy()
        return capture

    def busy(self) -> PortBusy:
        """It is there, and gives no picture."""
        return PortBusy(f"{self.name}: the camera gives no picture",
                        found=f"{self.place} is there" if self.kind == "usb" else "no picture",
                        likely="another program has it, or it is no camera",
                        remedy="fuser -v /dev/video* names who has it; v4l2-ctl --list-devices")

    def _look(self) -> None:
        here = sorted(str(p) for p in Path("/dev").glob("video*"))
        if not Path(self.place).exists():
            raise PortMissing(f"{self.name}: there is no camera {self.place}",
                              found=", ".join(here) or "no /dev/video*", likely="cable pulled out",
                              remedy=f"usb:{here[0]}" if here else "plug it in, ls /dev/video*")
        if not os.access(self.place, os.R_OK | os.W_OK):
            raise PortDenied(f"{self.name}: {self.place} may not be opened", found="no permission",
                             remedy="sudo usermod -aG video $USER ; then log in again")

    def _ribbon(self, cv2: ModuleType) -> str:
        told = [line for line in cv2.getBuildInformation().splitlines() if "GStreamer" in line]
        if not any("YES" in line for line in told):
            raise UsageError(f"{self.name}: this OpenCV has no GStreamer",
                             found=f"opencv {cv2.__version__} in {cv2.__file__}",
                             expected="the OpenCV of JetPack, which has it",
                             remedy="pip uninstall opencv-python-headless; a virtual environment "
                                    "with --system-site-packages sees JetPack's")
        return _CSI.format(number=self.place, width=self.width, height=self.height, fps=self.fps)


def opencv() -> ModuleType:
    """The module ``cv2``. Raises UsageError where it is not installed."""
    try:
        import cv2
    except ImportError as why:
        raise UsageError("a camera needs OpenCV", found=f"{why.name or 'cv2'} is not installed",
                         remedy=install_command("camera")) from why
    module: ModuleType = cv2
    return module


def device_of(text: str) -> Device:
    """The device that a URL names; it is not opened. Raises UsageError."""
    try:
        parts = urlsplit(text, allow_fragments=False)
    except ValueError as why:
        raise _no_camera(text, str(why)) from why
    place = parts.netloc + parts.path
    if parts.scheme not in KINDS:
        raise _no_camera(text, parts.scheme or "neither usb: nor csi:")
    if place.isascii() and place.isdigit():
        place = place if parts.scheme == "csi" else f"/dev/video{place}"
    elif parts.scheme == "csi" or not place.startswith("/"):
        raise _no_camera(text, place or "no device")
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    given: dict[str, int] = {}
    for name, value in pairs:
        if name not in RANGES or name in given:
            raise UsageError(f"{text}: options of a camera", expected=", ".join(RANGES),
                             found=f"{name} twice" if name in given else name)
        given[name] = _whole(text, name, value)
    return Device(text, parts.scheme, place, **given)


def _whole(text: str, name: str, value: str) -> int:
    least, most = RANGES[name]
    if not (value.isascii() and value.isdigit() and least <= int(value) <= most):
        raise UsageError(f"{name}={value} makes no sense", found=text,
                         expected=f"a whole number from {least} to {most}")
    return int(value)


def _no_camera(text: str, found: str) -> UsageError:
    return UsageError(f"{text!r} is no camera", found=found, expected=EXPECTED)
