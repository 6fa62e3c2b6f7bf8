"""What the last scans say about the lidar itself: pace, lost beams, blind sectors, its sense."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, radians, tau

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, Scan

SCANS = 16
"""Scans that are looked at: 2 s."""
BINS = 72
"""Of 5 deg, some 8 beams of each scan: 128 drop-outs in a row are no accident."""
BLIND = radians(10.0)
"""rad: narrower ones are a post or a lead."""
PROFILE = 360
SHIFTS = np.arange(-40, 41)
"""deg that are tried between two scans: 0.13 s at 5 rad/s."""
SEEN = 90
"""deg of a profile that must be there to be compared."""
APART = 0.5
"""Logarithm of two distances that have nothing to do with each other; also where one lacks."""
TURNS = radians(4.0)
"""rad between two scans from which on a turn shows in them."""
ENOUGH = radians(60.0)
"""rad of turns before anything is said of the sense."""
FASTEST = 8.25
"""1/s, from where on upstream saw a gap at the front left."""


@dataclass(frozen=True, slots=True)
class LidarHealth:
    """Of the last 2 s of scans.

    rate [1/s]; beams: of a revolution; lost: share of beams of packets that never came;
    returned: share of beams that came back; blind: sectors (from, to) [rad, to the left]
    from which nothing did; sense: how the scans turn over how the car turned, 1 right, -1
    mirrored, None = it has not turned enough.
    """

    rate: float
    beams: float
    lost: float
    returned: float
    blind: tuple[tuple[float, float], ...]
    sense: float | None

    def sentences(self) -> Iterator[str]:
        """What a person should look at; nothing = all is well."""
        if self.rate > FASTEST:
            yield f"it turns {self.rate:.2f} times a second: above 8.25 a sector may be lost"
        if self.lost > 0.01:
            yield f"{100 * self.lost:.0f} % of the beams are lost on the line"
        for start, end in self.blind:
            yield (f"nothing comes back from {degrees(start):.0f} to {degrees(end):.0f} deg "
                   "(left positive): a part of the car, glass, or more than 10 m of room")
        if self.sense is not None and self.sense < -0.3:
            yield ("its scans turn against the gyro: inverted in [lidar] of car.toml is wrong, or "
                   "the gyro's sign")


class Watch:
    """Looks at scans as they come. yaw [rad]: of the car, unwrapped, at each."""

    def __init__(self) -> None:
        self._scans: deque[Scan] = deque(maxlen=SCANS)
        self._last: tuple[Scan, float] | None = None
        self._both = self._car = self._sum = 0.0

    def add(self, scan: Scan, yaw: float) -> None:
        """One more scan."""
        self._scans.append(scan)
        last, self._last = self._last, (scan, yaw)
        if last is None or abs(turn := yaw - last[1]) <= TURNS:
            return
        before, after = _profile(last[0]), _profile(scan)
        if min(np.isfinite(before).sum(), np.isfinite(after).sum()) >= SEEN:
            self._both += turn * turned(before, after)
            self._car += turn * turn
            self._sum += abs(turn)

    def health(self) -> LidarHealth | None:
        """None before the first scan."""
        if not self._scans:
            return None
        came = sum(map(len, self._scans))
        missing = sum(map(_missing, self._scans))
        back = np.concatenate([np.isfinite(s.distance) for s in self._scans])
        where = np.concatenate([s.bearing for s in self._scans])
        return LidarHealth(
            float(np.mean([s.rate for s in self._scans])), came / len(self._scans),
            missing / (came + missing), float(back.mean()), tuple(blind(where[back])),
            self.sense)

    @property
    def sense(self) -> float | None:
        """As ``LidarHealth.sense``."""
        return self._both / self._car if self._sum > ENOUGH else None


_ROLLED = (np.arange(PROFILE) - np.array(SHIFTS)[:, None]) % PROFILE
"""Indices (shifts, PROFILE): each row is a profile turned by one of ``SHIFTS``."""


def turned(before: FloatArray, after: FloatArray) -> float:
    """Angle [rad] by which the car turned between two profiles, as the scans tell it."""
    costs = np.fmin(np.abs(after[_ROLLED] - before), APART).mean(axis=1)
    return radians(float(SHIFTS[int(np.argmin(costs))]))


def _missing(scan: Scan) -> int:
    """Beams between the first and the last that never came."""
    if len(scan) < 2:
        return 0
    return round(float(scan.after[-1] / np.median(np.diff(scan.after)))) - (len(scan) - 1)


def _profile(scan: Scan) -> FloatArray:
    """Logarithm of the distance at each deg to the left; NaN where nothing came back."""
    out = np.full(PROFILE, np.nan)
    seen = np.isfinite(scan.distance)
    index = np.round(np.degrees(scan.bearing[seen])).astype(int) % PROFILE
    out[index] = np.log(scan.range[seen])
    return out


def blind(bearing: FloatArray) -> Iterator[tuple[float, float]]:
    """Sectors (from, to) [rad, to the left] without any of these directions, from ``BLIND`` on."""
    counts = np.bincount((bearing % tau / tau * BINS).astype(int) % BINS, minlength=BINS)
    dark: BoolArray = counts == 0
    if dark.all():
        yield -tau / 2.0, tau / 2.0
        return
    edges = np.flatnonzero(~dark)
    for a, b in pairwise([*edges, edges[0] + BINS]):
        width = (b - a - 1) * tau / BINS
        if width >= BLIND:
            start = (a + 1) * tau / BINS
            start -= tau if start > tau / 2.0 else 0.0
            yield start, start + width
