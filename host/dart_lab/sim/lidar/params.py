"""What a simulated lidar is like: stated in the URL, or hidden in the seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from dart_hal.car.lidar import DEFAULT_MOUNT_X
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Mount

OFF = ("0", "none")


@dataclass(frozen=True, slots=True)
class LidarParams:
    """One unit and how it sits.

    rate [1/s]: revolutions; ripple: share by which the speed swings within one; skew: relative
    error of its clock; noise [m]: one sigma of a distance; dropout: share of beams that do not
    come back; least, most [m]: nearer and further ones do not; scale: true distance over the
    one that it tells; x, y [m], yaw [rad]: mount; clockwise: 1 upright, 0 upside down; gap
    [rad]: width of a part of the turn, at 45 deg to the left, from which nothing comes back;
    delay [s]: from a packet's last sample to its first byte, jitter [s]: the most that comes
    on top until the host has it; lost: share of packets of which a byte is damaged; hertz: 1 =
    it tells its rate, as later firmware does; spot [rad]: width of the laser beam, of which one
    half may lie on a near thing and the other on a far one.
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
        """How it truly sits."""
        return Mount(self.x, self.y, self.yaw, self.clockwise != 0.0, self.scale)


OPTIONS = tuple(f.name for f in fields(LidarParams))
_RANGE = {"rate": (4.0, 12.0), "ripple": (0.0, 0.2), "skew": (-0.005, 0.005), "noise": (0.0, 1.0),
          "dropout": (0.0, 1.0), "least": (0.0, 10.0), "most": (0.1, 16.0), "scale": (0.9, 1.1),
          "x": (-1.0, 1.0), "y": (-1.0, 1.0), "yaw": (-math.pi, math.pi), "clockwise": (0.0, 1.0),
          "gap": (0.0, math.tau), "delay": (0.0, 0.1), "jitter": (0.0, 0.1), "lost": (0.0, 0.9),
          "hertz": (0.0, 1.0), "spot": (0.0, 0.1)}


def hidden_lidar(seed: int) -> LidarParams:
    """The unit of a seed; of seed 0: as its plan says, with noise and drop-outs.

    A bare X4 turns a little below 8 Hz. Mounting: its screws have 3 mm of play in holes 57 mm
    apart. Scale: the 1.5 % that spoil a localiser. 100 ppm: a quartz in a warm case.
    """
    if seed == 0:
        return LidarParams()
    rng = np.random.default_rng([seed, 510])

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return LidarParams(
        rate=between(7.3, 8.1), ripple=between(0.0, 0.01), skew=between(-1e-4, 1e-4),
        noise=between(0.012, 0.018), scale=between(0.985, 1.015),
        x=DEFAULT_MOUNT_X + between(-0.003, 0.003), y=between(-0.003, 0.003),
        yaw=between(-0.03, 0.03))


def lidar_of(text: str, seed: int) -> LidarParams | None:
    """What ``lidar=...`` of a URL means: 1, or ``rate=8,noise=0.01``; None = there is none.

    Raises UsageError.
    """
    if text in OFF:
        return None
    hidden = hidden_lidar(seed)
    if text == "1":
        return hidden
    given: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name not in _RANGE or name in given:
            raise UsageError(f"lidar={text} makes no sense", found=part,
                             expected="1, or NAME=NUMBER,... once each, of " + ", ".join(OPTIONS))
        given[name] = _number(name, value)
    return replace(hidden, **given)


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    least, most = _RANGE[name]
    if not least <= value <= most:
        raise UsageError(f"lidar: {name}={text} makes no sense", found=text,
                         expected=f"a number from {least:g} to {most:g}")
    return value
