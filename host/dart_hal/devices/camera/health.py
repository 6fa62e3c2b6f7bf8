"""What the last images say about the camera: pace, late ones, how old they are when they come."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from dart_hal.core.types import Image

SPAN = 2.0
"""s that are looked at."""
LATE = 1.5
"""Of the median time between two images: beyond it one is late, or one was lost."""
OFTEN = 0.1
"""Share of late images from which on a person should know: exposure alone swings by a few."""
OLD = 0.2
"""s from taking to arrival, beyond which nobody should drive by it: 0.4 m at 2 m/s."""


@dataclass(frozen=True, slots=True)
class CameraHealth:
    """Of the last 2 s of images. rate [1/s]; late: share that came later than half a period; age
    [s]: median from taking to arrival; size [bytes]: median of an image."""

    rate: float
    late: float
    age: float
    size: int

    def sentences(self) -> Iterator[str]:
        """What a person should look at; nothing = all is well."""
        if self.late > OFTEN:
            yield f"{100.0 * self.late:.0f} % of the images come late"
        if self.age > OLD:
            yield f"an image is {self.age:.2f} s old when it comes"


class Watch:
    """``add`` each image; ``health`` any time."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float, int]] = deque()

    def add(self, image: Image) -> None:
        """The next image."""
        self._seen.append((image.arrival, image.t, len(image.jpeg)))
        while self._seen[-1][0] - self._seen[0][0] > SPAN:
            self._seen.popleft()

    def health(self) -> CameraHealth | None:
        """None before the second image."""
        if len(self._seen) < 2:
            return None
        gaps = [b[1] - a[1] for a, b in pairwise(self._seen)]
        usual = median(gaps)
        late = sum(gap > LATE * usual for gap in gaps) / len(gaps)
        span = self._seen[-1][1] - self._seen[0][1]
        return CameraHealth(len(gaps) / span if span > 0.0 else 0.0, late,
                            median(arrival - t for arrival, t, _ in self._seen),
                            int(median(size for _, _, size in self._seen)))
