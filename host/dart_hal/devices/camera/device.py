"""Camera devices: parsing of camera URLs, checks, and opening through OpenCV."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from dart_hal.core.errors import PortBusy, PortDenied, PortMissing, UsageError
from dart_hal.core.process.extras import install_command

CAMERA_URLS = "usb:0, usb:/dev/video0?width=640&height=480&fps=15, csi:0, or top in sim://"
OPTION_RANGES = {"width": (16, 4096), "height": (16, 4096), "fps": (1, 120), "quality": (1, 100)}
CAMERA_SCHEMES = ("usb", "csi")
# GStreamer pipeline of a Jetson's CSI camera; only the newest image is buffered.
_CSI = ("nvarguscamerasrc sensor-id={number} ! video/x-raw(memory:NVMM),width={width},"
        "height={height},framerate={fps}/1 ! nvvidconv ! video/x-raw,format=BGRx ! videoconvert ! "
        "video/x-raw,format=BGR ! appsink drop=true max-buffers=1")


@dataclass(frozen=True, slots=True)
class CameraDevice:
    """Camera of a URL, and its settings.

    kind: usb or csi; place: /dev/videoN, or the number of the CSI connector; width, height [px],
    fps [1/s]: requested, the camera uses its nearest mode; quality: of JPEG, 1..100.
    """

    name: str
    kind: str
    place: str
    width: int = 640
    height: int = 480
    fps: int = 15
    quality: int = 80

    def capture(self) -> Any:
        """Open and return a ``cv2.VideoCapture``.

        Raises UsageError, PortMissing, PortDenied, PortBusy.
        """
        cv2 = opencv()
        if self.kind == "csi":
            return self._open(cv2, self._csi_pipeline(cv2), cv2.CAP_GSTREAMER)
        self._check_presence()
        capture = self._open(cv2, self.place, cv2.CAP_V4L2)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.height)
        capture.set(cv2.CAP_PROP_FPS, self.fps)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # buffered images would be old
        return capture

    def _open(self, cv2: ModuleType, place: str, api: int) -> Any:
        capture = cv2.VideoCapture(place, api)
        if not capture.isOpened():
            capture.release()
            raise self.busy_error()
        return capture

    def busy_error(self) -> PortBusy:
        """Return the error for a camera that is present and gives no picture."""
        return PortBusy(f"{self.name}: the camera gives no picture",
                        found=f"{self.place} exists" if self.kind == "usb" else "no picture",
                        likely="another program uses it, or it is no camera",
                        remedy="fuser -v /dev/video* lists programs that use it; "
                               "v4l2-ctl --list-devices")

    def _check_presence(self) -> None:
        """Raise PortMissing or PortDenied if the device file is missing or not permitted."""
        here = sorted(str(p) for p in Path("/dev").glob("video*"))
        if not Path(self.place).exists():
            raise PortMissing(f"{self.name}: there is no camera {self.place}",
                              found=", ".join(here) or "no /dev/video*", likely="cable pulled out",
                              remedy=f"usb:{here[0]}" if here else "plug it in, ls /dev/video*")
        if not os.access(self.place, os.R_OK | os.W_OK):
            raise PortDenied(f"{self.name}: {self.place} may not be opened", found="no permission",
                             remedy="sudo usermod -aG video $USER ; then log in again")

    def _csi_pipeline(self, cv2: ModuleType) -> str:
        """Return the GStreamer pipeline. Raises UsageError if this OpenCV has no GStreamer."""
        lines = [line for line in cv2.getBuildInformation().splitlines() if "GStreamer" in line]
        if not any("YES" in line for line in lines):
            raise UsageError(f"{self.name}: this OpenCV has no GStreamer",
                             found=f"opencv {cv2.__version__} in {cv2.__file__}",
                             expected="an OpenCV with GStreamer, built for this Python: that of "
                                      "JetPack is for its own",
                             remedy="build OpenCV with GStreamer, or use a USB camera: usb:0")
        return _CSI.format(number=self.place, width=self.width, height=self.height, fps=self.fps)


def opencv() -> ModuleType:
    """Return the module ``cv2``. Raises UsageError if it is not installed."""
    try:
        import cv2
    except ImportError as why:
        raise UsageError("a camera needs OpenCV", found=f"{why.name or 'cv2'} is not installed",
                         remedy=install_command("camera")) from why
    module: ModuleType = cv2
    return module


def parse_camera_url(text: str) -> CameraDevice:
    """Return the device of a URL, without opening it. Raises UsageError."""
    try:
        parts = urlsplit(text, allow_fragments=False)
    except ValueError as why:
        raise _no_camera(text, str(why)) from why
    place = parts.netloc + parts.path
    if parts.scheme not in CAMERA_SCHEMES:
        raise _no_camera(text, parts.scheme or "neither usb: nor csi:")
    if place.isascii() and place.isdigit():
        place = place if parts.scheme == "csi" else f"/dev/video{place}"
    elif parts.scheme == "csi" or not place.startswith("/"):
        raise _no_camera(text, place or "no device")
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    given: dict[str, int] = {}
    for name, value in pairs:
        if name not in OPTION_RANGES or name in given:
            raise UsageError(f"{text}: options of a camera", expected=", ".join(OPTION_RANGES),
                             found=f"{name} twice" if name in given else name)
        given[name] = _parse_whole(text, name, value)
    return CameraDevice(text, parts.scheme, place, **given)


def _parse_whole(text: str, name: str, value: str) -> int:
    """Return the value of an option as an integer. Raises UsageError outside its range."""
    minimum, maximum = OPTION_RANGES[name]
    if not (value.isascii() and value.isdigit() and minimum <= int(value) <= maximum):
        raise UsageError(f"{name}={value} is not allowed", found=text,
                         expected=f"a whole number from {minimum} to {maximum}")
    return int(value)


def _no_camera(text: str, found: str) -> UsageError:
    return UsageError(f"{text!r} is no camera", found=found, expected=CAMERA_URLS)
