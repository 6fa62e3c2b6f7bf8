"""Health of a camera from its images, and the size of a JPEG."""

from __future__ import annotations

import pytest

from dart_hal.core.types import Image
from dart_hal.devices.camera.health import CameraHealthMonitor


def health(times, age=0.05):
    watch = CameraHealthMonitor()
    for t in times:
        watch.add(Image(t + age, t, bytes(1000)))
    return watch.health()


def test_a_steady_camera_has_no_problem():
    found = health([0.1 * n for n in range(60)])
    assert found.rate == pytest.approx(10.0)
    assert (found.late, found.size) == (0.0, 1000)
    assert found.age == pytest.approx(0.05)
    assert list(found.sentences()) == []


def test_late_and_old_images_are_reported():
    found = health([0.1 * n for n in range(20) if n % 5], age=0.3)
    assert found.late > 0.1
    assert [message for message in found.sentences() if "late" in message]
    assert [message for message in found.sentences() if "0.30 s old" in message]


def test_one_image_gives_no_health():
    assert health([1.0]) is None


@pytest.mark.parametrize("jpeg", [b"", b"\xff\xd8", b"GIF89a", b"\xff\xd8\x00\xc0" + bytes(9)])
def test_what_is_no_jpeg_has_no_size(jpeg):
    with pytest.raises(ValueError, match="no JPEG"):
        Image(0.0, 0.0, jpeg).size  # noqa: B018 - it is looked up
