"""Parameters of a simulated lidar, stated in the URL or drawn from the seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from dart_hal.car.lidar import DEFAULT_MOUNT_X
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Mount

LIDAR_OFF = ("0", "none")


@dataclass(frozen=True, slots=True)
class LidarParams:
    """Parameters of one unit and its mounting.

    rate [1/s]: revolutions; ripple: relative variation of the speed within one; skew: relative
    error of its clock; noise [m]: standard deviation of a distance; dropout: share of beams without
    an echo; least, most [m]: range; scale: true over reported distance; x, y [m], yaw [rad]: mount;
    clockwise: 1 upright, 0 upside down; gap [rad]: width of a sector without echoes, at 45 deg to
    the left; delay [s]: from the last sample of a packet to its first byte, jitter [s]: largest
    further delay to the host; lost: share of packets with a damaged byte; hertz: 1 = it reports its
    rate, as later firmware does; spot [rad]: width of the laser beam, whose halves may hit objects
    at different distances.
    """

    rate: float = 7.9
    ripple: float = 0.0
    skew: float = 0.0
    noise: float = 0.015
    dropout: float = 0.03
    least: float = 0.12
    most: float = 10.0
    scale: float = 1.0
    x: float = DEFAULT_MOUNT_X
    y: float = 0.0
    yaw: float = 0.0
    clockwise: float = 1.0
    gap: float = 0.0
    delay: float = 0.0
    jitter: float = 1e-3
    lost: float = 0.0
    hertz: float = 1.0
    spot: float = 0.0

    @property
    def mount(self) -> Mount:
        """Return the true mounting."""
        return Mount(self.x, self.y, self.yaw, self.clockwise != 0.0, self.scale)


# Options of ``lidar=`` with their ranges.
LIDAR_OPTIONS = tuple(f.name for f in fields(LidarParams))
_RANGE = {"rate": (4.0, 12.0), "ripple": (0.0, 0.2), "skew": (-0.005, 0.005), "noise": (0.0, 1.0),
          "dropout": (0.0, 1.0), "least": (0.0, 10.0), "most": (0.1, 16.0), "scale": (0.9, 1.1),
          "x": (-1.0, 1.0), "y": (-1.0, 1.0), "yaw": (-math.pi, math.pi), "clockwise": (0.0, 1.0),
          "gap": (0.0, math.tau), "delay": (0.0, 0.1), "jitter": (0.0, 0.1), "lost": (0.0, 0.9),
          "hertz": (0.0, 1.0), "spot": (0.0, 0.1)}


def hidden_lidar(seed: int) -> LidarParams:
    """Return the unit of a seed; seed 0: nominal, with noise and drop-outs.

    An X4 without speed control turns a little below 8 Hz. Mounting: screws with 3 mm of play in
    holes at a distance of 57 mm. Scale: 1.5 %, which makes localisation fail. 100 ppm: a warm
    quartz.
    """
    if seed == 0:
        return LidarParams()
    rng = np.random.default_rng([seed, 510])

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return LidarParams(
        rate=draw(7.3, 8.1), ripple=draw(0.0, 0.01), skew=draw(-1e-4, 1e-4),
        noise=draw(0.012, 0.018), scale=draw(0.985, 1.015),
        x=DEFAULT_MOUNT_X + draw(-0.003, 0.003), y=draw(-0.003, 0.003),
        yaw=draw(-0.03, 0.03))


def parse_lidar(text: str, seed: int) -> LidarParams | None:
    """Parse ``lidar=...`` of a URL: 1, or ``rate=8,noise=0.01``; None = no lidar.

    Raises UsageError.
    """
    if text in LIDAR_OFF:
        return None
    hidden = hidden_lidar(seed)
    if text == "1":
        return hidden
    given: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name not in _RANGE or name in given:
            raise UsageError(f"lidar={text} is not understood", found=part,
                             expected="1, or NAME=NUMBER,... once each, of "
                                      + ", ".join(LIDAR_OPTIONS))
        given[name] = _parse_number(name, value)
    return replace(hidden, **given)


def _parse_number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    least, most = _RANGE[name]
    if not least <= value <= most:
        raise UsageError(f"lidar: {name}={text} is out of range", found=text,
                         expected=f"a number from {least:g} to {most:g}")
    return value
