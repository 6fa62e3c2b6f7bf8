"""Health of a camera from its last images: rate, delayed images, age at arrival."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from dart_hal.core.types import Image

# s of images that are evaluated.
HEALTH_SPAN = 2.0
# Of the median time between two images: after a longer gap an image is late, or one was lost.
LATE_RATIO = 1.5
# Share of late images that is reported; a few per cent are caused by the exposure alone.
MAX_LATE_SHARE = 0.1
# s from exposure to arrival; a controller should not use older images: 0.4 m at 2 m/s.
MAX_IMAGE_AGE = 0.2


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """Health over the last 2 s of images.

    rate [1/s]; late: share of images that were late by more than half a period; age [s]: median
    from exposure to arrival; size [bytes]: median of an image.
    """

    rate: float
    late: float
    age: float
    size: int

    def sentences(self) -> Iterator[str]:
        """Yield a message for each problem."""
        if self.late > MAX_LATE_SHARE:
            yield f"{100.0 * self.late:.0f} % of the images arrive late"
        if self.age > MAX_IMAGE_AGE:
            yield f"an image is {self.age:.2f} s old when it arrives"


class CameraHealthMonitor:
    """Collects the last images and computes the health of their camera."""

    def __init__(self) -> None:
        self._images: deque[tuple[float, float, int]] = deque()

    def add(self, image: Image) -> None:
        """Add the next image."""
        self._images.append((image.arrival, image.t, len(image.jpeg)))
        while self._images[-1][0] - self._images[0][0] > HEALTH_SPAN:
            self._images.popleft()

    def health(self) -> CameraHealth | None:
        """Return the health over the last images; None before the second one."""
        if len(self._images) < 2:
            return None
        gaps = [b[1] - a[1] for a, b in pairwise(self._images)]
        usual = median(gaps)
        late = sum(gap > LATE_RATIO * usual for gap in gaps) / len(gaps)
        span = self._images[-1][1] - self._images[0][1]
        return CameraHealth(len(gaps) / span if span > 0.0 else 0.0, late,
                            median(arrival - t for arrival, t, _ in self._images),
                            int(median(size for _, _, size in self._images)))
