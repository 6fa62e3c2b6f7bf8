"""A camera: a thread reads it through OpenCV, stamps its images and encodes them as JPEG.

The car never waits for it: ``poll`` returns the images that have arrived. A camera that is gone is
opened again.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress
from typing import Any

from dart_hal.core.errors import DartHalError, NoImage
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Image
from dart_hal.devices.camera.device import CameraDevice, opencv

# s without an image before it is reported: 15 images at the usual rate.
MAX_IMAGE_GAP = 1.0
# s between two attempts to open a camera that is gone.
CAMERA_RETRY_INTERVAL = 0.5
# Failed reads in a row until a camera counts as gone; a USB camera misses single images.
MAX_FAILED_READS = 5
# Images that wait for the car: half a second. If the car does not poll, the oldest is dropped.
MAX_WAITING_IMAGES = 8
# s that closing waits for a read; OpenCV itself waits 10 s for a camera that hangs.
CLOSE_TIMEOUT = 0.5


class CvCamera:
    """``ImageSource`` of a device, which is opened at once. Raises the errors of
    ``CameraDevice.capture``, and PortBusy if the first read returns no image."""

    def __init__(self, device: CameraDevice) -> None:
        self.name = device.name
        self._device = device
        self._cv2 = opencv()
        self._capture: Any = device.capture()
        if not self._capture.read()[0]:
            self._capture.release()
            raise device.busy_error()
        self._waiting: deque[tuple[float, float, bytes]] = deque(maxlen=MAX_WAITING_IMAGES)
        self._arrived = elapsed()
        self._gone = ""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> DartHalError | None:
        """Present error: the device is gone, or it hangs."""
        silent = elapsed() - self._arrived
        if self._gone:
            return NoImage(f"{self.name}: the camera is gone", found=self._gone,
                           likely="cable pulled out, or another program took it",
                           remedy="plug it in again: it continues by itself")
        return None if silent < MAX_IMAGE_GAP else NoImage(
            f"{self.name}: the camera is silent", found=f"no image for {silent:.1f} s")

    def poll(self, now: float) -> list[Image]:
        """Return the images that have arrived, as ``ImageSource``; times of the reading thread."""
        images = []
        here = elapsed()
        while self._waiting:
            taken, arrived, jpeg = self._waiting.popleft()
            images.append(Image(now - (here - arrived), now - (here - taken), jpeg))
        return images

    def close(self) -> None:
        """End the thread and release the device; if a read hangs, that happens at its end."""
        self._stop.set()
        self._thread.join(CLOSE_TIMEOUT)

    def _run(self) -> None:
        """Read images and open a lost device again until ``close``; body of the thread."""
        failed = 0
        while not self._stop.is_set():
            if self._capture is None:
                self._stop.wait(CAMERA_RETRY_INTERVAL)
                self._reopen()
                continue
            if self._read():
                failed = 0
                continue
            failed += 1
            if failed >= MAX_FAILED_READS:
                failed = 0
                self._lose(f"{self._device.place}: {MAX_FAILED_READS} reads without a picture")
            else:
                self._stop.wait(0.5 / self._device.fps)
        if self._capture is not None:
            self._capture.release()

    def _read(self) -> bool:
        """Read an image into ``_waiting``; return whether there was one.

        Its stamp is the end of the read: exposure and transfer are before it.
        """
        ok, picture = self._capture.read()
        taken = elapsed()
        if not ok:
            return False
        ok, jpeg = self._cv2.imencode(".jpg", picture, [self._cv2.IMWRITE_JPEG_QUALITY,
                                                        self._device.quality])
        if ok:
            self._arrived = elapsed()
            self._waiting.append((taken, self._arrived, jpeg.tobytes()))
        return bool(ok)

    def _lose(self, why: str) -> None:
        self._gone = why
        self._capture.release()
        self._capture = None

    def _reopen(self) -> None:
        with suppress(DartHalError):
            self._capture = self._device.capture()
            self._gone = ""
            self._arrived = elapsed()
