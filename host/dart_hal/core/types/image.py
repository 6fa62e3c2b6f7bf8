"""One image of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from struct import error as StructError  # noqa: N812
from struct import unpack_from

# Markers of JPEG that precede the size of the image (ITU-T T.81, table B.1).
START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


@dataclass(frozen=True, slots=True)
class Image:
    """One JPEG image: its times on the car's clock and its bytes.

    arrival [s]: reception; t [s]: exposure, rounded to whole ns as in a recording; jpeg: bytes.
    """

    arrival: float
    t: float
    jpeg: bytes

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", round(self.t * 1e9) / 1e9)

    def __repr__(self) -> str:
        return f"<Image t {self.t:.3f} s, {len(self.jpeg)} bytes>"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]. Raises ValueError for invalid JPEG data."""
        # Segments of JPEG: 0xFF, kind, length (2 bytes, included), data. Find the start of frame.
        offset = 2
        try:
            while self.jpeg[:2] == b"\xff\xd8":
                mark, kind, length = unpack_from(">BBH", self.jpeg, offset)
                if mark != 0xFF:
                    break
                if kind in START_OF_FRAME:
                    height, width = unpack_from(">HH", self.jpeg, offset + 5)
                    return width, height
                offset += 2 + length
        except StructError:
            pass
        raise ValueError(f"{len(self.jpeg)} bytes that are no JPEG")
