"""Health of the lidar from its last scans: rate, lost beams, blind sectors, sense of rotation."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, radians, tau

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, Scan

# Scans that are evaluated: 2 s.
HEALTH_SCANS = 16
# Bins of 5 deg, each with about 8 beams per scan: 128 drop-outs in a row are not random.
SECTOR_BINS = 72
# rad: a narrower sector without returns is a post or a cable.
MIN_BLIND_WIDTH = radians(10.0)
# Bins of 1 deg for the comparison of two scans.
PROFILE_BINS = 360
# Share of the beams that have an echo, at least: lidars in a room have 0.9 and more. With 0.1,
# simulated cars hit a wall at 0.7 m/s: too few beams meet the width of the car.
MIN_ECHO_SHARE = 0.3
# deg: rotations that are tried between two scans; a scan lasts 0.13 s, in which 5 rad/s is 37 deg.
SHIFTS_DEG = np.arange(-40, 41)
# Bins with a distance that a profile needs for a comparison.
MIN_PROFILE_BEAMS = 90
# Limit of |log(d1 / d2)|: the cost of unrelated distances, and of a bin without a distance.
MAX_LOG_DIFFERENCE = 0.5
# rad between two scans; a smaller turn is not used.
MIN_TURN_STEP = radians(4.0)
# rad between two scans; a larger turn is outside the rotations that are tried.
MAX_TURN_STEP = radians(float(SHIFTS_DEG[-1]))
# Revolutions between the end of a scan and the start of the next one that is compared with it: less
# than one scan is lost. With a gap of 0.4 to 1 s, 2 to 4 of 25 drives had the wrong sign.
MAX_SCAN_PAUSE = 0.5
# rad of turns in total before the sense is reported.
MIN_TOTAL_TURN = radians(60.0)
# 1/s; above it the original DART software found a gap at the front left of an X4.
MAX_X4_RATE = 8.25
# Samples per second by which an X4 is recognised: 5000, less those that are lost at the ends.
X4_SAMPLE_RATE = (4750.0, 5250.0)


@dataclass(frozen=True, slots=True)
class LidarHealth:
    """Health over the last 2 s of scans.

    rate [1/s]; beams: per revolution; lost: share of the beams whose packets were lost; returned:
    share of the received beams with a distance; blind: sectors (from, to) [rad, to the left]
    without a return; sense: rotation of the scans divided by that of the car, 1 right, -1 mirrored,
    None = the car has not turned enough.
    """

    rate: float
    beams: float
    lost: float
    returned: float
    blind: tuple[tuple[float, float], ...]
    sense: float | None

    def sentences(self) -> Iterator[str]:
        """Yield a message for each problem."""
        samples = self.rate * self.beams / max(1.0 - self.lost, 0.01)
        if self.rate > MAX_X4_RATE and X4_SAMPLE_RATE[0] < samples < X4_SAMPLE_RATE[1]:
            yield f"it turns {self.rate:.2f} times a second: above 8.25 a sector may be lost"
        if self.lost > 0.01:
            yield f"{100 * self.lost:.0f} % of the beams are lost on the line"
        if self.returned < MIN_ECHO_SHARE:
            yield (f"only {100 * self.returned:.0f} % of the beams have an echo: guard_distance "
                   "withholds throttle (a dirty window, too little power, or the open)")
        for start, end in self.blind:
            yield (f"nothing comes back from {degrees(start):.0f} to {degrees(end):.0f} deg "
                   "(left positive): a part of the car, glass, or more than 10 m of room")
        if self.sense is not None and self.sense < -0.3:
            yield ("its scans turn against the gyro: inverted in [lidar] of car.toml is wrong, or "
                   "the gyro's sign")


class LidarHealthMonitor:
    """Collects the last scans and compares their rotation with that of the car.

    The sense is the least-squares slope of the scan rotation r over the car's turn t between two
    scans: sum(r t) / sum(t^2).
    """

    def __init__(self) -> None:
        self._scans: deque[Scan] = deque(maxlen=HEALTH_SCANS)
        self._last: tuple[Scan, float] | None = None
        self._both = self._car = self._sum = 0.0

    def add(self, scan: Scan, yaw: float) -> None:
        """Add a scan; yaw [rad]: heading of the car at its time, unwrapped."""
        self._scans.append(scan)
        last = self._last
        self._last = (scan, yaw)
        if last is None or not MIN_TURN_STEP < abs(turn := yaw - last[1]) < MAX_TURN_STEP:
            return
        # After a gap the car is elsewhere, and the rotation that fits best means nothing.
        if scan.t[0] - last[0].t[-1] > MAX_SCAN_PAUSE / scan.rate:
            return
        previous = _profile(last[0])
        profile = _profile(scan)
        if min(np.isfinite(previous).sum(), np.isfinite(profile).sum()) >= MIN_PROFILE_BEAMS:
            self._both += turn * estimate_turn(previous, profile)
            self._car += turn * turn
            self._sum += abs(turn)

    def health(self) -> LidarHealth | None:
        """Return the health over the last scans; None before the first one."""
        if not self._scans:
            return None
        received = sum(map(len, self._scans))
        missing = sum(map(_count_missing, self._scans))
        returned = np.concatenate([np.isfinite(s.distance) for s in self._scans])
        bearings = np.concatenate([s.bearing for s in self._scans])
        return LidarHealth(
            float(np.mean([s.rate for s in self._scans])), received / len(self._scans),
            missing / (received + missing), float(returned.mean()),
            tuple(find_blind_sectors(bearings[returned])), self.sense)

    @property
    def sense(self) -> float | None:
        """As ``LidarHealth.sense``."""
        return self._both / self._car if self._sum > MIN_TOTAL_TURN else None


# Indices (shifts, PROFILE_BINS): each row rotates a profile by one of SHIFTS_DEG.
_ROLLED = (np.arange(PROFILE_BINS) - np.array(SHIFTS_DEG)[:, None]) % PROFILE_BINS


def estimate_turn(previous: FloatArray, profile: FloatArray) -> float:
    """Estimate the angle [rad] by which the car turned between two profiles.

    It is the rotation with the smallest mean |log(d1 / d2)|, limited to MAX_LOG_DIFFERENCE.
    """
    costs = np.fmin(np.abs(profile[_ROLLED] - previous), MAX_LOG_DIFFERENCE).mean(axis=1)
    return radians(float(SHIFTS_DEG[int(np.argmin(costs))]))


def _count_missing(scan: Scan) -> int:
    """Count the lost beams between the first and the last one of a scan, from their times."""
    if len(scan) < 2:
        return 0
    return round(float(scan.after[-1] / np.median(np.diff(scan.after)))) - (len(scan) - 1)


def _profile(scan: Scan) -> FloatArray:
    """Return the logarithm of the distance at each deg to the left; NaN without a return."""
    out = np.full(PROFILE_BINS, np.nan)
    returned = np.isfinite(scan.distance)
    index = np.round(np.degrees(scan.bearing[returned])).astype(int) % PROFILE_BINS
    out[index] = np.log(scan.range[returned])
    return out


def find_blind_sectors(bearing: FloatArray) -> Iterator[tuple[float, float]]:
    """Yield the sectors (from, to) [rad, to the left] of MIN_BLIND_WIDTH without a bearing."""
    index = (bearing % tau / tau * SECTOR_BINS).astype(int) % SECTOR_BINS
    counts = np.bincount(index, minlength=SECTOR_BINS)
    dark: BoolArray = counts == 0
    if dark.all():
        yield -tau / 2.0, tau / 2.0
        return
    edges = np.flatnonzero(~dark)
    for a, b in pairwise([*edges, edges[0] + SECTOR_BINS]):
        width = (b - a - 1) * tau / SECTOR_BINS
        if width >= MIN_BLIND_WIDTH:
            start = (a + 1) * tau / SECTOR_BINS
            start -= tau if start > tau / 2.0 else 0.0
            yield start, start + width
