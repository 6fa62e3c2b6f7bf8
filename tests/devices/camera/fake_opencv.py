"""A device that is no camera, and an OpenCV that reads it: what the tests unplug and hang."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import numpy as np

JPEG = b"\xff\xd8\xff\xc0\x00\x0b\x08" + (480).to_bytes(2, "big") + (640).to_bytes(2, "big")


class FakeOpenCV(SimpleNamespace):
    """Replaces the module ``cv2``. path: the device, a file; there: whether it gives pictures;
    hangs: set while a read does not return; opened, held: captures made, and not yet released;
    settings: what was set; gstreamer: YES or NO."""

    CAP_V4L2, CAP_GSTREAMER, IMWRITE_JPEG_QUALITY = 200, 1800, 1
    CAP_PROP_FRAME_WIDTH, CAP_PROP_FRAME_HEIGHT, CAP_PROP_FPS, CAP_PROP_BUFFERSIZE = 3, 4, 5, 38
    __version__, __file__ = "0.0", "/fake/cv2.py"

    def __init__(self, path, fps=50.0):
        super().__init__(path=path, fps=fps, there=True, takes=True, gstreamer="NO", opened=[],
                         held=0, settings={}, count=0, hangs=threading.Event())

    def getBuildInformation(self):  # noqa: N802 - OpenCV's name
        return f"  Video I/O:\n    GStreamer:   {self.gstreamer}\n"

    def VideoCapture(self, place, api):  # noqa: N802 - OpenCV's name
        self.opened.append((place, api))
        return Capture(self)

    def imencode(self, kind, picture, options):
        assert kind == ".jpg"
        assert picture.shape == (480, 640, 3)
        return True, np.frombuffer(JPEG + bytes([self.count % 256]), np.uint8)


class Capture:
    def __init__(self, cv2):
        self._cv2, self._next = cv2, time.monotonic()
        self._open = cv2.takes
        cv2.held += self._open

    def isOpened(self):  # noqa: N802 - OpenCV's name
        return self._open

    def set(self, prop, value):
        self._cv2.settings[prop] = value

    def read(self):
        while self._cv2.hangs.is_set():
            time.sleep(0.01)
        if not self._cv2.there:
            return False, None
        self._next = max(self._next + 1.0 / self._cv2.fps, time.monotonic() - 0.1)
        time.sleep(max(self._next - time.monotonic(), 0.0))
        self._cv2.count += 1
        return True, np.zeros((480, 640, 3), np.uint8)

    def release(self):
        self._cv2.held -= self._open
        self._open = False
