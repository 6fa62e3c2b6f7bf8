"""Cameras of this computer, read through OpenCV: JPEG images with times of the car's clock."""

from __future__ import annotations

from dart_hal.core.added_sensors import open_added_sensor
from dart_hal.core.ports import ImageSource
from dart_hal.devices.camera.capture import CvCamera
from dart_hal.devices.camera.device import CAMERA_SCHEMES, parse_camera_url


def open_camera(text: str) -> ImageSource:
    """Open the camera of a URL: ``usb:0``, ``usb:/dev/video0?width=640&height=480&fps=15``,
    ``csi:0``, or of another package (``core.added_sensors``).

    Raises UsageError, PortMissing, PortDenied, PortBusy, PluginFailed.
    """
    if text.partition(":")[0] not in CAMERA_SCHEMES:
        added: ImageSource | None = open_added_sensor("camera", text)
        if added is not None:
            return added
    return CvCamera(parse_camera_url(text))
