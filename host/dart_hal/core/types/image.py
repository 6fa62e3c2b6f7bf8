"""One picture of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from struct import error as StructError  # noqa: N812
from struct import unpack_from

FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG behind which the size stands (ITU-T T.81, table B.1)."""


@dataclass(frozen=True, slots=True)
class Image:
    """arrival [s]: when it was there for the car, t [s]: when it was taken, both on the car's
    clock; jpeg: its bytes. ``t`` is of whole ns, as a recording keeps it."""

    arrival: float
    t: float
    jpeg: bytes

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", round(self.t * 1e9) / 1e9)

    def __repr__(self) -> str:
        return f"<Image t {self.t:.3f} s, {len(self.jpeg)} bytes>"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]. Raises ValueError for bytes that are no JPEG."""
        at = 2
        try:
            while self.jpeg[:2] == b"\xff\xd8":
                mark, kind, length = unpack_from(">BBH", self.jpeg, at)
                if mark != 0xFF:
                    break
                if kind in FRAMES:
                    height, width = unpack_from(">HH", self.jpeg, at + 5)
                    return width, height
                at += 2 + length
        except StructError:
            pass
        raise ValueError(f"{len(self.jpeg)} bytes that are no JPEG")
