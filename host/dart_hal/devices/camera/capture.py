"""A thread that reads a camera through OpenCV, stamps its images and makes JPEG of them.

The car never waits for it: ``poll`` takes what is there. A camera that is gone is opened again.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import suppress
from typing import Any

from dart_hal.core.errors import DartHalError, NoImage
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Image
from dart_hal.devices.camera.device import Device, opencv

PATIENCE = 1.0
"""s without an image from which on it is said: fifteen of a usual camera."""
AGAIN = 0.5
"""s between two tries to open a camera that is gone."""
MISSED = 5
"""Reads without a picture until a camera counts as gone; a USB camera misses single ones."""
KEPT = 8
"""Images that wait for the car: half a second. A car that stands still loses the oldest."""
ENDS = 0.5
"""s that closing waits for a read; OpenCV's own waits 10 s for a camera that hangs."""


class CvCamera:
    """``ImageSource`` of a device, which is opened at once. Raises what ``Device.capture`` does,
    PortBusy where no first picture comes."""

    def __init__(self, device: Device) -> None:
        self.name, self._device, self._cv2 = device.name, device, opencv()
        self._capture: Any = device.capture()
        if not self._capture.read()[0]:
            self._capture.release()
            raise device.busy()
        self._waiting: deque[tuple[float, float, bytes]] = deque(maxlen=KEPT)
        self._came = elapsed()
        self._gone = ""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    @property
    def trouble(self) -> DartHalError | None:
        """The device is gone, or it hangs."""
        silent = elapsed() - self._came
        if self._gone:
            return NoImage(f"{self.name}: the camera is gone", found=self._gone,
                           likely="cable pulled out, or another program took it",
                           remedy="plug it in again: it goes on by itself")
        return None if silent < PATIENCE else NoImage(
            f"{self.name}: the camera is silent", found=f"no image for {silent:.1f} s")

    def poll(self, now: float) -> list[Image]:
        """As ``ImageSource``; the times are those of the reading thread."""
        images, here = [], elapsed()
        while self._waiting:
            taken, came, jpeg = self._waiting.popleft()
            images.append(Image(now - (here - came), now - (here - taken), jpeg))
        return images

    def close(self) -> None:
        """The thread lets go of the device; one that hangs in a read does so at its end."""
        self._stop.set()
        self._thread.join(ENDS)

    def _run(self) -> None:
        missed = 0
        while not self._stop.is_set():
            if self._capture is None:
                self._stop.wait(AGAIN)
                self._reopen()
                continue
            if self._read():
                missed = 0
                continue
            missed += 1
            if missed >= MISSED:
                missed = 0
                self._lose(f"{self._device.place}: {MISSED} reads without a picture")
            else:
                self._stop.wait(0.5 / self._device.fps)
        if self._capture is not None:
            self._capture.release()

    def _read(self) -> bool:
        """One image into ``_waiting``. The stamp is that of the read's end: exposure and transfer
        lie before it."""
        ok, picture = self._capture.read()
        taken = elapsed()
        if not ok:
            return False
        ok, jpeg = self._cv2.imencode(".jpg", picture, [self._cv2.IMWRITE_JPEG_QUALITY,
                                                        self._device.quality])
        if ok:
            self._came = elapsed()
            self._waiting.append((taken, self._came, jpeg.tobytes()))
        return bool(ok)

    def _lose(self, why: str) -> None:
        self._gone = why
        self._capture.release()
        self._capture = None

    def _reopen(self) -> None:
        with suppress(DartHalError):
            self._capture = self._device.capture()
            self._gone = ""
            self._came = elapsed()
